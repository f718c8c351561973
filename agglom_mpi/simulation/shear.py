"""Images of a box in shear: which of them is meant, what crossing a face of y does, and its work.

Nothing here does anything in another box. Velocities are those of the laboratory: a grain flies
straight, and one that crosses a face of y goes on as its image, which is shifted along x by the
offset of the moment and has the velocity of the flow there. Two grains collide in one image of
the box, into which one of them is brought before, and from which it is put back.

Each change of an image does work on the box: the energy of what is in it changes by what the mean
flow outside gives. That is all the work of the shear, and it stands in the ledger.
"""

import math

import numpy as np

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.boundary import flow_speed, image_offset, is_sheared, wrapped
from agglom_mpi.simulation.particles import WORK


@inlined
def shift_image(scene, particle, ledger, images, time):
    """Move a particle up by whole `images` of the sheared box at `time` in s, into that image.

    The work goes into the `ledger`, unless it is None.
    """
    escape, side = scene.escape, 2.0 * scene.half_width
    change = images * flow_speed(escape, side)
    if ledger is not None:
        ledger.energy[WORK] += particle["mass"] * change * (particle["u"] + 0.5 * change)
    ahead = particle["x"] + images * image_offset(escape, side, time)
    particle["x"] = wrapped(escape, ahead, scene.half_width)
    particle["y"] += images * side
    particle["u"] += change


@inlined
def put_into_box(scene, particle, ledger, time):
    """Take a particle outside a sheared face to its image in the box; `ledger` may be None."""
    if is_sheared(scene.escape) and abs(particle["y"]) > scene.half_width:
        images = math.floor((particle["y"] + scene.half_width) / (2.0 * scene.half_width))
        shift_image(scene, particle, ledger, -images, time)


@inlined
def bring_together(scene, one, other, ledger, time):
    """Move the other particle into the image in which it is nearest; return by how many images."""
    images = 0.0
    if is_sheared(scene.escape):
        images = -np.rint((other["y"] - one["y"]) / (2.0 * scene.half_width))
        if images != 0.0:
            shift_image(scene, other, ledger, images, time)
    return images


@inlined
def put_back(scene, particle, ledger, images, time):
    """Move a particle back that was moved by `images` to meet another."""
    if is_sheared(scene.escape) and images != 0.0:
        shift_image(scene, particle, ledger, -images, time)


@inlined
def plus_images(escape, value, images, each):
    """Return a value plus `images` times what `each` image up adds to it."""
    return value + images * each if is_sheared(escape) else value


@inlined
def columns_beside(escape, row, first, last, cells, shifts):
    """First and last cell along x in which to look from cells `first` to `last`, in a row of y.

    Rows beyond the faces of y are images, ahead by `shifts` cells and a fraction of one: there one
    more cell is in reach. At most each column of the box once.
    """
    if is_sheared(escape) and (row < 0 or row >= cells):
        first, last = (
            (first + shifts, last + shifts + 1) if row < 0 else (first - shifts - 1, last - shifts)
        )
        count = min(last - first, cells - 1)
        first -= cells * math.floor(first / cells)
        last = first + count
    return first, last
