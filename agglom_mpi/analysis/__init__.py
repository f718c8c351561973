"""Results of a campaign file in numbers and tables; nothing is drawn."""
