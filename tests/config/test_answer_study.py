"""The file of an answer study: what its settings change, and what is wrong with it."""

from pathlib import Path

import pytest
from measured_runs import write_measured

from agglom_mpi.config.answer_study import load_answer_study
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.simulation.engines import FixedSteps

QUESTION = Path("jobs/quickstart.yaml").absolute()
STUDY = """
question: quickstart.yaml
seeds: 3
samples: 50
targets: [0.2, 0.1]
compared: 0.1
default:
  search: {method: random, population: 8}
  scene: {particles: 60}
factors:
  engines:
    steps:
      scene: {engine: {law: fixed, steps: 30}}
  searches:
    genetic: {search: {population: 6, parents: 2}}
"""


def load(folder, text=STUDY):
    (folder / "quickstart.yaml").write_text(QUESTION.read_text())
    (folder / "study.yaml").write_text(text)
    return load_answer_study(str(folder / "study.yaml"))


def test_a_setting_changes_the_default_and_keeps_the_rest(tmp_path):
    study = load(tmp_path)
    default, steps, genetic = (setting.campaign for setting in study.settings)
    assert default.scene.particles == steps.scene.particles == 60
    assert default.search.method == steps.search.method == "random"
    assert isinstance(steps.scene.engine, FixedSteps)
    assert steps.scene.engine.steps == 30
    assert genetic.search.population == 6
    assert genetic.scene.engine == default.scene.engine
    question = load_campaign(str(QUESTION))
    assert study.question.identity() == question.identity()
    for campaign in (default, steps, genetic):
        assert campaign.final is None
        assert campaign.ensemble == question.ensemble
        assert campaign.objective.ratio == question.objective.ratio


def test_factors_begin_with_the_default(tmp_path):
    factors = load(tmp_path).factors
    assert {name: [s.name for s in settings] for name, settings in factors.items()} == {
        "engines": ["default", "steps"],
        "searches": ["default", "genetic"],
    }


def test_each_setting_has_files_of_its_own(tmp_path):
    study = load(tmp_path)
    assert [setting.stem for setting in study.settings] == [
        "default",
        "engines_steps",
        "searches_genetic",
    ]


def test_a_seed_is_written_into_the_text_of_a_setting(tmp_path):
    setting = load(tmp_path).settings[0]
    campaign = setting.campaign.with_seed(7)
    assert campaign.identity() == setting.campaign.identity() | {"seed": 7}
    assert type(campaign).from_text(campaign.text).identity() == campaign.identity()


@pytest.mark.parametrize(
    ("old", "new", "line", "field", "value"),
    [
        ("seeds: 3", "seeds: 1", 3, "seeds", "1"),
        ("samples: 50", "sample: 50", 4, "sample", "samples"),
        ("targets: [0.2, 0.1]", "targets: [0.1, 0.2]", 5, "targets", "descend"),
        ("compared: 0.1", "compared: 0.3", 6, "compared", "0.3"),
        ("question: quickstart.yaml", "question: 3", 2, "question", "3"),
        ("method: random", "method: randon", 8, "default.search.method", "randon"),
        ("particles: 60", "particels: 60", 9, "default.scene.particels", "particles"),
        ("steps: 30", "steps: -3", 13, "factors.engines.steps.scene.engine.steps", "-3"),
        ("scene: {engine", "scenes: {engine", 13, "factors.engines.steps.scenes", "scene"),
        ("    steps:\n", "    steps: 3\n    others:\n", 12, "factors.engines.steps", "3"),
        ("parents: 2", "parents: 3", 15, "factors.searches.genetic.search.parents", "3"),
    ],
)
def test_a_mistake_is_one_line_with_file_line_field_and_value(
    tmp_path, old, new, line, field, value
):
    assert STUDY.count(old) == 1
    with pytest.raises(CampaignError) as caught:
        load(tmp_path, STUDY.replace(old, new))
    [found] = [problem for problem in caught.value.problems if problem.field == field]
    assert (found.file, found.line) == (str(tmp_path / "study.yaml"), line)
    assert value in found.message


def test_settings_of_one_stem_are_refused(tmp_path):
    text = STUDY.replace("  searches:\n", "    STEPS: {search: {population: 9}}\n  searches:\n")
    with pytest.raises(CampaignError, match=r"factors\.engines\.STEPS") as caught:
        load(tmp_path, text)
    assert caught.value.problems[0].line == 14


def test_a_set_needs_a_growth_target(tmp_path):
    text = QUESTION.read_text().replace("{law: growth_target, ratio: 2}", "maximum_growth")
    load(tmp_path)
    (tmp_path / "quickstart.yaml").write_text(text)
    (tmp_path / "study.yaml").write_text(f"answer: set\n{STUDY.lstrip()}")
    with pytest.raises(CampaignError, match="maximum_growth") as caught:
        load_answer_study(str(tmp_path / "study.yaml"))
    assert caught.value.problems[0].field == "answer"


def test_a_question_that_is_missing_is_named(tmp_path):
    with pytest.raises(CampaignError, match=r"other\.yaml"):
        load(tmp_path, STUDY.replace("question: quickstart", "question: other"))


def test_a_question_of_measured_data_has_no_study(tmp_path):
    write_measured(tmp_path)
    text = STUDY.replace("quickstart.yaml", "measured.yaml")
    assert text != STUDY
    with pytest.raises(CampaignError) as caught:
        load(tmp_path, text)
    [problem] = caught.value.problems
    assert problem.field == "question"


@pytest.mark.parametrize("study", sorted(Path("jobs/accuracy").glob("answer_*.yaml")), ids=str)
def test_the_studies_of_the_jobs_are_valid(study):
    found = load_answer_study(str(study))
    assert len(found.settings) == len({setting.stem for setting in found.settings})
    assert found.compared in found.targets
    assert found.seeds >= 10 or study.stem == "answer_quick"


OWN = """
question: {question}
seeds: 2
samples: 8
targets: [0.1]
compared: 0.1
factors:
  searches:
    Sobol: {{search: {{method: sobol, population: 8}}}}
"""


@pytest.mark.parametrize("job", ["own_laws/dust", "questions/fines"])
def test_code_beside_the_question_runs_only_if_allowed(tmp_path, job):
    question = Path("jobs", f"{job}.yaml").absolute()
    path = tmp_path / "study.yaml"
    path.write_text(OWN.format(question=question))
    with pytest.raises(CampaignError, match="--allow-code"):
        load_answer_study(str(path))
    study = load_answer_study(str(path), allow_code=True)
    for setting in study.settings:
        assert setting.campaign.scene == study.question.scene
        assert setting.campaign.user_function == study.question.user_function
        assert setting.campaign.objective.name == study.question.objective.name
    assert study.settings[1].campaign.search.method == "sobol"
