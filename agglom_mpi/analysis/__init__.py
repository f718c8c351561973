"""What a finished campaign file says; nothing is drawn."""
