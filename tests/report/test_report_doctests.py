"""The examples in the docstrings of the public Python interface run."""

import doctest
import shutil

import pytest

from agglom_mpi import campaign_file
from agglom_mpi.report import campaign_plots, drawing
from agglom_mpi.search.objectives import growth as growth_objectives

pytest.importorskip("matplotlib")

OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


@pytest.mark.parametrize("module", [campaign_file, campaign_plots, drawing, growth_objectives])
def test_examples_in_docstrings_give_what_they_say(module, finished, tmp_path, monkeypatch):
    from matplotlib import pyplot

    shutil.copy(finished, tmp_path / "quickstart.h5")
    monkeypatch.chdir(tmp_path)
    tried = doctest.testmod(module, optionflags=OPTIONS)
    pyplot.close("all")
    assert tried.failed == 0
    assert tried.attempted > 0


def test_every_plot_and_table_has_an_example():
    public = [
        value
        for kind in (campaign_file.CampaignFile, campaign_plots.CampaignPlots)
        for name, value in vars(kind).items()
        if name.startswith("plot_") or name in ("best", "strings", "samples", "generations")
    ]
    texts = [getattr(value, "fget", None) or value for value in public]
    assert len(texts) == 20
    assert [text.__name__ for text in texts if ">>>" not in (text.__doc__ or "")] == []
