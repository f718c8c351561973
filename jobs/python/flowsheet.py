"""Steady states of a granulator whose fines go back, by an exported emulator and NumPy alone.

    agglom-invert jobs/story/growth_by_half.yaml
    agglom export growth_by_half.h5 --emulator granulator.npz
    python jobs/python/flowsheet.py granulator.py

A feed of equal grains fills a share of the granulator, and recycled fines fill more of it. Granules
are lognormal about the emulated growth; those below the sieve go back as grains. The ranges are two
standard deviations of the emulator.
"""

import math
import runpy
import sys

FEED_FRACTION = 0.04  # share of the volume that the feed alone fills
SIEVE = 1.3  # width of its openings, relative to a grain
SPREAD = 1.4  # geometric standard deviation of the granules' sizes


def fines(growth):
    """Return the share of the granules' mass that passes the sieve."""
    return 0.5 * math.erfc(math.log(growth / SIEVE) / math.log(SPREAD) / math.sqrt(2.0))


def steady(emulator, speed, temperature=330.0, shift=0.0, most=200):
    """Return recycled mass per mass of feed, growth and passes until nothing changes.

    Growth is shifted by so many standard deviations of the emulator. A loading outside of its box
    is a ValueError.
    """
    recycled = 0.0
    for passes in range(1, most):
        fraction = FEED_FRACTION * (1.0 + recycled)
        size_ratio = (6.0 * fraction / math.pi) ** (1.0 / 3.0)
        string = {"relative_speed": speed, "size_ratio": size_ratio, "temperature": temperature}
        growth = float(emulator.mean(string) + shift * emulator.deviation(string))
        returned = fines(growth) * (1.0 + recycled)
        if abs(returned - recycled) < 1e-6:
            return recycled, growth, passes
        recycled = returned
    raise ValueError(f"speed {speed:g} m/s: no steady state in {most} passes")


if __name__ == "__main__":
    emulator = runpy.run_path(sys.argv[1])["PortableEmulator"]()
    for speed in (1.0, 2.0, 3.0, 5.0, 10.0):
        try:
            recycled, growth, passes = steady(emulator, speed)
            low, high = (steady(emulator, speed, shift=shift)[0] for shift in (2.0, -2.0))
        except ValueError as error:
            print(f"{speed:4g} m/s: {error}")
        else:
            print(f"{speed:4g} m/s: recycle {recycled:.3f} ({low:.3f} to {high:.3f})", end=", ")
            print(f"growth {growth:.3f}, {passes} passes")
    #    1 m/s: size_ratio: value 0.703010705; must be in 0.4 to 0.7
    #    2 m/s: recycle 1.391 (1.111 to 1.680), growth 1.213, 25 passes
    #    3 m/s: recycle 0.610 (0.575 to 0.653), growth 1.442, 16 passes
    #    5 m/s: recycle 0.214 (0.186 to 0.246), growth 1.778, 7 passes
    #   10 m/s: recycle 0.090 (0.068 to 0.118), growth 2.075, 5 passes
