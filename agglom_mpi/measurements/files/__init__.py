"""Files of measured sizes: tables in text files, size curves and lists of grains."""
