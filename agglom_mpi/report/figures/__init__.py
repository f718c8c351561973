"""The figures of a campaign file: each declares itself; `figure.figures` finds them."""
