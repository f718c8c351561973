"""What the samples of a string are warned of: few particles left, and all changes early."""

from agglom_mpi.analysis.run_warnings import early_changes, few_left


def test_nine_of_300_particles_are_too_few():
    [line] = few_left(9.0, 300)
    assert line.startswith("scene.particles: 9 of 300 particles are left on average; fewer than 10")
    assert few_left(10.0, 300) == []


def test_changes_that_end_early_are_counted():
    [line] = early_changes(897, 3)
    assert line.startswith("scene.end_time: all 897 merges and breakups of 3 samples happen in the")


def test_a_scene_that_begins_with_few_grains_has_not_lost_them():
    assert few_left(2.0, 2) == []
    assert few_left(3.0, 9) == []
    assert len(few_left(9.5, 10)) == 1
