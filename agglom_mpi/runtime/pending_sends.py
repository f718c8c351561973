"""Messages that are on their way to another rank."""

from typing import Any

from numpy.typing import NDArray


class PendingSends:
    """Requests of messages that MPI still sends, each with its buffer, which MPI reads meanwhile.

    Whoever waited for one would hear nothing while the receiver is held up.
    """

    def __init__(self) -> None:
        self._sends: list[tuple[Any, NDArray[Any]]] = []

    def __len__(self) -> int:
        return len(self._sends)

    def add(self, request: Any, records: NDArray[Any]) -> None:
        """Add a message by the request that MPI returned for it."""
        self._sends.append((request, records))

    def forget_sent(self) -> None:
        """Let go of what has been sent."""
        if self._sends:
            self._sends = [(sent, kept) for sent, kept in self._sends if not sent.Test()]

    def wait(self) -> None:
        """Wait until everything has been sent."""
        for request, _ in self._sends:
            request.Wait()
        self._sends.clear()
