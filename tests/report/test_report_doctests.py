"""The examples in the docstrings of the public Python interface run."""

import doctest
import shutil

import pytest

from agglom_mpi import campaign_file, formatting
from agglom_mpi.search.objectives import growth as growth_objectives

pytest.importorskip("matplotlib")

OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


@pytest.mark.parametrize("module", [campaign_file, formatting, growth_objectives])
def test_examples_in_docstrings_give_what_they_say(module, finished, tmp_path, monkeypatch):
    from matplotlib import pyplot

    shutil.copy(finished, tmp_path / "quickstart.h5")
    monkeypatch.chdir(tmp_path)
    tried = doctest.testmod(module, optionflags=OPTIONS)
    pyplot.close("all")
    assert tried.failed == 0
    assert tried.attempted > 0


def test_every_table_has_an_example():
    names = ("best", "strings", "samples")
    texts = [getattr(vars(campaign_file.CampaignFile)[name], "fget", None) for name in names[1:]]
    assert all(">>>" in text.__doc__ for text in (campaign_file.CampaignFile.best, *texts))
