"""README says what is so: its Python runs, its commands are the ones that CI runs, its links lead somewhere."""

import re
from pathlib import Path

import numpy as np

import cdpr_sim as cdpr

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_block_runs_and_agrees():
    """As printed, from the first line to the last."""
    (block,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    names: dict = {}
    exec(block, names)
    assert cdpr.compare(names["static"], names["settled"]).agrees
    assert names["xml"].startswith("<mujoco")


def test_the_winches_block_runs_and_comes_to_rest():
    """As printed; where ``solve`` says."""
    (block,) = (one for one in re.findall(r"```py\n(.*?)```", README, flags=re.DOTALL) if "winches=True" in one)
    names: dict = {"cdpr": cdpr}
    exec(block, names)
    static = cdpr.solve(names["robot"], (0.3, 0.25, 0.15))
    np.testing.assert_allclose(names["data"].sensor("position").data, static.position, rtol=0, atol=1e-9)


def test_commands_stand_behind_their_markers():
    """.ci/run takes the two commands from README by these."""
    for marker, word in (("main job", "cdpr-sim settle"), ("tests", "pytest")):
        assert re.search(rf"<!-- {marker} -->\n```sh\n.*{word}.*\n```\n", README)


def test_links_lead_to_files():
    """Every relative link."""
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", README) if "://" not in link]
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
