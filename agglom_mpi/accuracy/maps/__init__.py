"""Where each method breaks: maps of the plane of two numbers of a scene, or of a law."""
