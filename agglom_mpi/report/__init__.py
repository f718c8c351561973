"""What people read: tables from a campaign file."""
