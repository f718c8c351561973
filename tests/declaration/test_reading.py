"""The names of components are mapped to classes in one place, own ones by the reading context."""

from typing import Annotated, ClassVar

import pytest

from agglom_mpi.config.scene import SceneSection
from agglom_mpi.declaration.choices import Choice
from agglom_mpi.declaration.components import In, UnknownComponentError, class_named
from agglom_mpi.declaration.declared import Declared
from agglom_mpi.declaration.reading import PLAIN, OwnComponents, Reading
from agglom_mpi.physics.friction import Friction
from agglom_mpi.physics.restitution import ConstantRestitution, PressureRestitution, Restitution
from agglom_mpi.simulation.boundary import Boundary


class Faster(Restitution):
    """A class that no file of the package declares."""

    in_files: ClassVar[bool] = False
    share: Annotated[float, In("1", above=0, below=1)]


class Known(OwnComponents):
    """Finds one class."""

    def find(self, name: str, kind: type) -> type:
        if name != "faster.py:Faster":
            raise ValueError(f"is {name!r}, which is not there")
        return Faster


class Scene(Declared):
    restitution: Annotated[Restitution, Choice(Restitution)]


READING = Reading(own=Known())


def test_a_name_is_mapped_to_the_class_of_the_package_or_to_an_own_one():
    assert class_named(Restitution, "constant") is ConstantRestitution
    assert class_named(Restitution, "faster.py:Faster", READING) is Faster


@pytest.mark.parametrize(
    ("kind", "name", "reading"),
    [
        (Restitution, "unknown", READING),
        (Restitution, None, READING),
        (Restitution, ["constant"], READING),
        (Restitution, "faster.py:Slower", READING),
        (Restitution, "faster.py:Faster", Reading()),
        (Friction, "faster.py:Faster", READING),
        (Boundary, "faster.py:Faster", READING),
    ],
)
def test_a_name_that_is_none_of_its_kind_is_refused(kind, name, reading):
    with pytest.raises(UnknownComponentError):
        class_named(kind, name, reading)


def test_a_field_reads_an_own_component_with_its_numbers():
    entry = {"restitution": {"law": "faster.py:Faster", "share": "30 %"}}
    with pytest.raises(ValueError, match="law"):
        Scene.checked(entry, READING)  # its class has no field of that name
    entry = {"restitution": {"law": "faster.py:Slower", "share": "30 %"}}
    with pytest.raises(ValueError, match="Slower"):
        Scene.checked(entry, READING)
    given = Faster(share=0.3)
    assert Scene.checked({"restitution": given}).restitution is given


def test_the_hardness_of_a_scene_follows_from_the_own_restitution_that_it_names(monkeypatch):
    entry = {"restitution": "faster.py:Faster"}
    fitting = SceneSection.with_default_hardness
    assert fitting(entry, READING)["hardness"] == "constant"
    monkeypatch.setattr(Faster, "needs_contact_pressure", True)
    assert fitting(entry, READING)["hardness"] == "arrhenius"
    assert fitting(entry, PLAIN)["hardness"] == "constant"
    assert PressureRestitution.needs_contact_pressure
