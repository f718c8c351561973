"""The sections of the page: each declares itself; `section.sections` finds them."""
