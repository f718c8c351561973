"""What an unknown name may have been meant as."""

from collections.abc import Iterable
from difflib import get_close_matches


def suggestion(name: str, allowed: Iterable[str]) -> str:
    """Return `did you mean 'NAME'?`, or all that is allowed if nothing is near.

    A name is near if all words of the unknown one are among its own, as those of `speed` are among
    those of `relative_speed`, or if it is spelt much the same.
    """
    names = list(allowed)
    words = set(name.split("_"))
    longer = [candidate for candidate in names if words <= set(candidate.split("_"))]
    near = longer if len(longer) == 1 else get_close_matches(name, names, n=1)
    return f"did you mean '{near[0]}'?" if near else f"allowed: {', '.join(names)}"
