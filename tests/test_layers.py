from pathlib import Path

from importlinter import cli

SETTINGS = Path(__file__).parents[1] / "setup.cfg"


def test_imports_point_down(capsys):
    status = cli.lint_imports(config_filename=str(SETTINGS), no_cache=True)
    assert status == 0, capsys.readouterr().out
