"""How the parts of a campaign are declared: sections, numbers with units, components and laws."""
