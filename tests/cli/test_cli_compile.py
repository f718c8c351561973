"""`agglom compile`: kernels ahead of a run."""

import re

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.simulation import compilation


def test_a_campaign_is_compiled_once(agglom, tiny_folder):
    first = agglom("compile", "tiny.yaml")
    assert first.exit_code == 0
    done, total = first.stdout.splitlines()
    assert re.fullmatch(r"tiny\.yaml: compiled (before|in .+)", done)
    assert re.fullmatch(r"[\d.]+ MiB of kernels in /.+", total)
    campaign = load_campaign("tiny.yaml")
    assert compilation.is_compiled(campaign.scene.build(campaign.parameters()), frames=True)
    again = agglom("compile", "tiny.yaml", "tiny.yaml")
    assert again.stdout.splitlines()[:2] == ["tiny.yaml: compiled before"] * 2
    assert again.stderr == ""


def test_a_mistake_is_found_before_anything_is_compiled(mistaken, monkeypatch):
    monkeypatch.setattr(compilation, "compile_kernels", None)
    assert "missing.yaml" in mistaken("compile", "tiny.yaml", "missing.yaml")


def test_a_campaign_with_code_is_compiled_without_running_it(agglom, tiny_folder, tmp_path):
    text = (tiny_folder / "tiny.yaml").read_text()
    law = "objective: {law: function, call: own:worth}\n"
    path = tmp_path / "own.yaml"
    path.write_text(re.sub(r"objective: .*\n", law, text))
    (tmp_path / "own.py").write_text("raise SystemExit('executed')\n")
    done = agglom("compile", path)
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{path}: compiled")
