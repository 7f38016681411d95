"""What commands on studies are shown with."""

from tests.studies.conftest import paper_results, scenario  # noqa: F401
