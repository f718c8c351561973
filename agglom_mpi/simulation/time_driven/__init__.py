"""The published steppers: fixed steps [A] and adaptive steps [B]."""
