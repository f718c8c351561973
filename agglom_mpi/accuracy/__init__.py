"""Error against run time, and stiff and extreme cases: what `agglom accuracy` measures."""
