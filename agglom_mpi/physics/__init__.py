"""One file per physical question; pure scalar formulas, no loops over particles."""
