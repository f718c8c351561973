"""Words that several parts of the program say in the same way."""


def counted(number: int, noun: str) -> str:
    """Write a number with its noun: `1 sample`, `2 samples`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
