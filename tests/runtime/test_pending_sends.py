"""Messages that are on their way keep their buffers, and nobody waits for them before the end."""

import numpy as np

from agglom_mpi.runtime.messages import PendingSends


class Request:
    """A message that is sent when its receiver is ready; a test never waits for it."""

    def __init__(self):
        self.sent = self.waited = False

    def Test(self):  # noqa: N802  (as MPI names it)
        return self.sent

    def Wait(self):  # noqa: N802
        self.waited = self.sent = True


def test_what_is_sent_is_let_go_and_the_rest_kept():
    sends, requests = PendingSends(), [Request(), Request()]
    for request in requests:
        sends.add(request, np.zeros(1))
    requests[1].sent = True
    sends.forget_sent()
    assert len(sends) == 1
    requests[0].sent = True
    sends.forget_sent()
    assert not sends
    assert not any(request.waited for request in requests)


def test_the_end_waits_for_everything():
    sends, requests = PendingSends(), [Request(), Request()]
    for request in requests:
        sends.add(request, np.zeros(1))
    sends.wait()
    assert all(request.waited for request in requests)
    assert not sends
