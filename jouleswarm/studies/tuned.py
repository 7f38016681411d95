"""Settings that tuning has found, each method's own: a TOML file that `benchmarks.tuning` writes.

robots = ["learning.lr=0.0013"]

[methods]
maml = ["meta.heads=shared", "meta.meta_lr=0.0019"]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.documents import parse_toml


class Tuned(BaseModel):
    """Overrides, `section.key=value`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robots: tuple[str, ...] = ()
    """Of every deployment."""
    methods: dict[str, tuple[str, ...]] = {}
    """Of a deployment with this method and no other one of these."""

    def of(self, methods: Sequence[str]) -> tuple[str, ...]:
        """What a deployment with these methods is given."""
        own = [self.methods[name] for name in methods if name in self.methods]
        return (*self.robots, *(own[0] if len(own) == 1 else ()))


UNTUNED = Tuned()


def read_tuned(path: Path | None) -> Tuned:
    """Nothing of no file.

    Raises:
        ConfigurationError: it cannot be read, or holds something else.
    """
    if path is None:
        return UNTUNED
    try:
        return Tuned.model_validate(parse_toml(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"--tuned {path}: cannot be read ({error}); benchmarks.tuning writes one") from error
    except ValidationError as error:
        first = error.errors()[0]
        told = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    except ValueError as error:
        told = str(error)
    raise ConfigurationError(
        f'--tuned {path}: {told}; expected robots = ["section.key=value", ...] and [methods] with such a list a method'
    )
