"""The tables of components are complete."""

from agglom_mpi.config.explanation import component_kinds, component_tables


def test_every_component_has_a_row_with_all_its_keys():
    rows = [line for line in component_tables().splitlines() if line.startswith("| `")]
    for kind in component_kinds().values():
        for name, component in kind.components().items():
            [row] = [
                row
                for row in rows
                if row.startswith(f"| `{name}` |")
                and all(
                    f"`{key}`" in row
                    for key in component.model_fields
                    if key not in (component.named_by, *component.not_in_files)
                )
                and (component.__doc__ or "").replace("  [", " [")[:9] in row
            ]
            assert len(row.split(" | ")) == 3
