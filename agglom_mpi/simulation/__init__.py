"""One sample: placement, motion, contacts and what is measured of them."""
