"""What `agglom doctor` looks at: is this machine fit to run campaigns, and what is to be mended."""
