"""The page of all fields, made from the models."""

from __future__ import annotations

import inspect
from pathlib import Path

from pydantic import BaseModel

from jouleswarm.common.scenario import reference
from jouleswarm.common.scenario.environments import LANDMARKS, factory_of
from jouleswarm.common.scenario.scenario import Scenario

PAGE = Path(__file__).parents[2] / "docs" / "scenarios.md"


def test_the_page_is_up_to_date() -> None:
    command = "python -m jouleswarm.common.scenario.reference > docs/scenarios.md"
    assert PAGE.read_text() == reference.reference(), f"make it again: {command}"


def test_a_field_is_told_with_its_default_bounds_and_meaning() -> None:
    lines = reference.reference().splitlines()
    assert "| `reward_window` | `5` | whole number, 1 to 1_000_000 | R is the mean over this many rounds |" in lines
    assert "| `ul_bit_per_j` | `200000.0` | number, 1e-06 to 1e+15 | uplink efficiency E_UL, bit/J |" in lines
    assert '| `optimizer` | `"adam"` | `"adam"`, `"sgd"` | of the robots\' gradient steps |' in lines
    assert "| `heading_jitter_deg` | `2.0` | number, 0 to below 45 |" in "\n".join(lines)
    assert "| `id` | required | whole number, 1 to 1_000_000 |" in "\n".join(lines)


def test_every_field_says_what_it_means() -> None:
    def unsaid(model: type[BaseModel], where: str) -> list[str]:
        found = []
        for name, field in model.model_fields.items():
            if (section := reference.section_of(field.annotation)) is not None:
                found += unsaid(section, f"{name}.")
            elif not field.description:
                found.append(f"{where}{name}")
        return found

    landmarks = factory_of(LANDMARKS, None)
    for model in (Scenario, landmarks.task, *landmarks.sections.values()):
        assert unsaid(model, "") == []
    assert inspect.getdoc(Scenario)
