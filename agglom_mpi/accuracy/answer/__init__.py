"""The error of what whole searches answer against what they cost."""
