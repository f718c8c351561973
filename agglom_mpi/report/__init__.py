"""Pages, figures and exports of a campaign file."""
