"""Carbon intensity of electricity by country, offline: yearly averages, life cycle, gCO2e a kWh.

`countries.csv` is of Our World in Data, "Yearly electricity data", after Ember (Yearly Electricity Data) and the Energy
Institute (Statistical Review of World Energy), each country's newest of 2021 to 2023; CC BY 4.0. CodeCarbon 3.3 has the
same numbers.
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator


@cache
def intensities() -> dict[str, float]:
    """Country, by its two letters of ISO 3166-1 -> gCO2e a kWh."""
    with Path(__file__).with_name("countries.csv").open(encoding="utf-8", newline="") as lines:
        return {line["country"]: float(line["g_per_kwh"]) for line in csv.DictReader(lines)}


def _known(country: str) -> str:
    if country not in intensities():
        raise ValueError(f"got {country!r:.60}, expected a country's two letters of ISO 3166-1, FI; or give g_per_kwh")
    return country


Country = Annotated[str, AfterValidator(_known)]
