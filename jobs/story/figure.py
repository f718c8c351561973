"""Mean growth over speed and size ratio, the line of growth by half, and what the search found."""

import matplotlib.pyplot as plt
import numpy as np

import agglom_mpi

file = agglom_mpi.open_campaign("growth_by_half.h5")
campaign = agglom_mpi.load_campaign("growth_by_half.yaml")
speeds, ratios, samples = np.geomspace(1, 30, 16), np.linspace(0.4, 0.7, 13), 50


def growth(speed: float, ratio: float) -> float:
    """Mean b/b0 at 330 K."""
    flow = {"relative_speed": speed, "size_ratio": ratio, "temperature": 330}
    return float(np.mean([campaign.simulate(flow, k).mean_radius_ratio for k in range(samples)]))


grown = np.array([[growth(speed, ratio) for speed in speeds] for ratio in ratios])

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
filled = ax.contourf(speeds, ratios, grown, 12, cmap="cividis")
figure.colorbar(filled, label="mean b/b⁰")
line = ax.contour(speeds, ratios, grown, [1.5], colors="white")
ax.clabel(line, fmt="%.1f")
best = file.best(6)
found = best["relative_speed"], best["size_ratio"]
ax.plot(*found, "o", color="tab:red", markeredgecolor="white", label="found")
ax.set(xscale="log", xlabel="relative speed (m/s)", ylabel="size ratio")
ax.set_xticks([1, 3, 10, 30], ["1", "3", "10", "30"])
ax.legend(loc="lower left")
figure.savefig("growth_by_half.png", dpi=120)
