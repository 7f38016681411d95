"""What commands are called with, and studies shown with."""

import sys
from collections.abc import Callable

import pytest

from jouleswarm.cli.main import main
from tests.studies.conftest import paper_results, scenario  # noqa: F401

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def jouleswarm(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Calls `jouleswarm ...`; returns exit code, stdout, stderr."""

    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["jouleswarm", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        code = ended.value.code
        out, err = capsys.readouterr()
        return (code if isinstance(code, int) else 0), out, err

    return call
