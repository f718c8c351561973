"""Means of a campaign's strings, by the exported file of this name, with NumPy alone."""

import math
from pathlib import Path
from typing import Any

import numpy as np

FORMAT, MAX_STRINGS, ROOT_5 = 1, 2048, math.sqrt(5.0)
GROWTH, OWN = "mean_radius_ratio", Path(__file__).with_suffix(".npz")


class PortableEmulator:
    """Gaussian processes, Matérn-5/2 (Rasmussen and Williams 2006, 2.25, 2.26, 4.17).

    Strings are SI numbers or arrays by name. `box` has the ends, unit and scale of each variable,
    `quantities` their units, `edges` their classes, `about` the campaign. Raises ValueErrors.
    """

    def __init__(self, file: Any = OWN) -> None:
        with np.load(file, allow_pickle=False) as found:
            self._of = a = {name: found[name] for name in found.files}
        if a["format"] != FORMAT:
            raise ValueError(f"{file}: format: value {a['format']}; must be {FORMAT}")
        columns = (a[key].tolist() for key in ("names", "lower", "upper", "units", "scales"))
        self.box = {name: tuple(of) for name, *of in zip(*columns, strict=True)}
        self.quantities, self.about = (dict(a[key].tolist()) for key in ("quantities", "about"))
        self.edges = {name: a[f"edges {name}"] for name in self.quantities if f"edges {name}" in a}

    def mean(self, strings: Any, quantity: str = GROWTH) -> Any:
        """Return the expected mean of a quantity at strings; the shares of a curve come last."""
        return self._at(strings, quantity)[0]

    def deviation(self, strings: Any, quantity: str = GROWTH) -> Any:
        """Return the standard deviation of `mean`: how unsure the emulator is."""
        return self._at(strings, quantity)[1]

    def probability(self, strings: Any) -> Any:
        """Return the probability that the mean is within the target's band and samples succeed."""
        if "band" not in self._of:
            raise ValueError("probability: the campaign has no target, whose set it would be of")
        mean, deviation = self._at(strings, str(self._of["target"]))
        scores = (self._of["band"] - mean[..., None]) / np.maximum(deviation, 1e-300)[..., None]
        below = 0.5 * np.vectorize(math.erfc, [float])(-scores / math.sqrt(2.0))
        fails = self._at(strings, "failing")[0] if "place failing" in self._of else 0.0
        return (below[..., 1] - below[..., 0]) * (1.0 - np.clip(fails, 0.0, 1.0))

    def _at(self, strings: Any, quantity: str) -> Any:
        if quantity not in self.quantities and quantity != "failing":
            raise ValueError(f"quantity: value {quantity}; must be {' or '.join(self.quantities)}")
        if wrong := sorted(set(self.box) ^ set(strings)):
            raise ValueError(f"{wrong[0]}: unknown or missing; must give {', '.join(self.box)}")
        columns = np.broadcast_arrays(*(np.asarray(strings[name], float) for name in self.box))
        for (name, (lower, upper, unit, _)), x in zip(self.box.items(), columns, strict=True):
            near = 1e-9 * (upper - lower)  # rounding
            if (out := ~((x >= lower - near) & (x <= upper + near))).any():
                span = f"must be in {lower:g} to {upper:g} {'' if unit == '1' else unit}".rstrip()
                raise ValueError(f"{name}: value {x[out].flat[0]:.9g}; {span}")
        x = np.stack([column.ravel() for column in columns], axis=1)
        parts = (x[i : i + MAX_STRINGS] for i in range(0, len(x) or 1, MAX_STRINGS))
        found = np.concatenate([self._block(quantity, part) for part in parts], axis=1)
        return found.reshape(2, *columns[0].shape, *found.shape[2 if found.shape[2] > 1 else 3 :])

    def _block(self, quantity: str, x: Any) -> Any:
        block, first, last = self._of[f"place {quantity}"]
        a, b = self._of, {k[2:]: v for k, v in self._of.items() if k.startswith(f"{block} ")}
        x, log, to = (a["factors"] * x) ** a["exponents"], a["logarithmic"], b["mixing"].T
        own = (np.where(log, np.log(np.where(log, x, 1.0)), x) - a["first"]) / a["widths"]
        groups = (np.log(x + a["offsets"]) @ a["powers"] - a["least"]) / a["spans"]
        at = np.hstack((own[:, b["kept"]], groups))
        means, variances = np.empty((2, len(x), len(to)))
        for i, length in enumerate(b["lengths"]):
            p, q = b["points"] / length, at / length
            r2 = (p**2).sum(axis=1)[:, None] + (q**2).sum(axis=1) - 2.0 * p @ q.T
            r = np.sqrt(np.maximum(r2, 0.0))
            across = b["variance"][i] * (1.0 + ROOT_5 * r + 5 / 3 * r**2) * np.exp(-ROOT_5 * r)
            variances[:, i] = b["variance"][i] - ((b["inverse"][i] @ across) ** 2).sum(axis=0)
            means[:, i] = b["centre"][i] + b["scale"][i] * (b["weights"][i] @ across)
        spread = (b["scale"] * np.sqrt(np.maximum(variances, 0.0))) ** 2 @ to**2 + b["rest"]
        return np.stack((b["offset"] + means @ to, np.sqrt(spread)))[:, :, first:last]
