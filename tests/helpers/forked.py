"""A function called in a copy of this process, so that what it does to memory ends with it."""

import faulthandler
import json
import os
import traceback


def called_in_child(function, *arguments):
    """Return what a function returns, as JSON has it, in a child; assert that it returns."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        faulthandler.disable()
        os.close(read)
        try:
            answer = {"returned": function(*arguments)}
        except BaseException:
            answer = {"raised": traceback.format_exc()}
        with open(write, "w") as stream:
            json.dump(answer, stream)
        os._exit(0)
    os.close(write)
    with open(read) as stream:
        said = stream.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code == 0, f"the child ended with {code}"
    answer = json.loads(said)
    assert "raised" not in answer, answer["raised"]
    return answer["returned"]
