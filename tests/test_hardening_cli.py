"""The command line where the world outside fails: pipes, disks, letters, interrupts, narrow terminals, odd names."""

import io
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import COMMANDS, app, main, terminal
from cdpr_sim.design import search
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.design.moves import Space
from cdpr_sim.report.analysis_tables import compensation_table
from cdpr_sim.robots.robot_file_text import as_toml
from studies.checked_lines import line_table

COMMAND = [sys.executable, "-c", "from cdpr_sim.__main__ import main; main()"]
STARTS = ["--starts", "40000"]
"""Of a search that takes 1.7 s of computing time; a release of what it finds takes another 1.3 s."""

ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1]), "COLUMNS": "80"}


def run(*words: str, columns: int = 80):
    return CliRunner().invoke(app, list(words), env={"COLUMNS": str(columns)})


def process(*words: str, **how):
    """The command in a process of its own, which ends with the test."""
    how = {"env": ENVIRONMENT, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "timeout": 600} | how
    return subprocess.run([*COMMAND, *words], **how, text=True)


def printed(table, columns: int) -> str:
    """The table as a terminal shows it."""
    console = Console(width=columns, file=io.StringIO())
    console.print(table)
    return console.file.getvalue()


def one_sentence(error: str, words: str) -> None:
    """On standard error, in a line, without a traceback."""
    assert words in error
    assert len(error.strip().splitlines()) == 1
    assert "Traceback" not in error


# ------------------------------------------------------------------------------------------------------ EXIT STATUSES


def ended(monkeypatch, stdout, *words: str) -> int:
    """The exit status of the command in this process; the test closes ``stdout``, as the end of a process does."""
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", stdout)
        patch.setattr(sys, "argv", ["cdpr-sim", *words])
        with pytest.raises(SystemExit) as end:
            main()
    return end.value.code


def test_a_full_output_is_one_sentence_and_a_status_of_its_own(monkeypatch, capsys):
    """1 would mean that the methods disagree."""
    with open("/dev/full", "w") as full:
        result = process("--help", stdout=full)
        assert result.returncode == terminal.OUTSIDE
        assert ended(monkeypatch, full, "solve", "cogiro", "--json") == terminal.OUTSIDE
    for error in (result.stderr, capsys.readouterr().err):
        one_sentence(error, "cdpr-sim: No space left on device")


def test_a_pipe_that_nobody_reads_is_no_error_message(monkeypatch, capsys):
    """``cdpr-sim robots | head -1``: silence, and a status that is not 1."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as pipe:
        result = process("--help", stdout=pipe)
        assert (result.returncode, result.stderr) == (terminal.OUTSIDE, "")
        assert ended(monkeypatch, pipe, "robots") == terminal.OUTSIDE
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("words", [["settle", "cogiro"], ["figures", "--list"]])
def test_letters_that_cannot_be_shown_are_question_marks(words, monkeypatch, tmp_path):
    """ASCII, as ``PYTHONIOENCODING=ascii`` has it: the same tables, in plain lines."""
    with open(tmp_path / "printed", "w+", encoding="ascii") as printed:
        assert ended(monkeypatch, printed, *words) == 0
        printed.seek(0)
        assert printed.read().count("\n") > 5


def test_no_memory_is_one_sentence(monkeypatch):
    """Nobody's mistake."""

    def exhausted(*_, **__):
        raise MemoryError

    monkeypatch.setattr(cdpr, "solve", exhausted)
    result = run("solve", "cogiro")
    assert result.exit_code == terminal.OUTSIDE
    one_sentence(result.stderr, "out of memory")


def test_a_full_disk_is_not_a_wrong_place(tmp_path):
    """Files may not grow beyond 1 kB: status 3, and nothing is left; a folder that is none is a mistake, status 2."""
    script = f"ulimit -f 1; exec '{sys.executable}' -c '{COMMAND[2]}' new '{tmp_path / 'mine'}'"
    environment = ENVIRONMENT | {"PYTHONDONTWRITEBYTECODE": "1"}
    result = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, timeout=600)
    assert result.returncode == terminal.OUTSIDE, result.stderr
    one_sentence(result.stderr, "mine.toml: cannot be written: File too large")
    assert not list(tmp_path.iterdir())


VIDEOS = """
import sys
from cdpr_sim.__main__ import main
words = "video two-cable --drive-seconds 1 --seconds 0.5 --fps 10 --size 320 240 --renderer raycast -o".split()
for place in sys.argv[1:]:
    sys.argv = ["cdpr-sim", *words, place]
    try:
        main()
    except SystemExit as end:
        print(end.code, flush=True)
"""


def test_a_disk_that_a_video_fills_is_one_sentence_and_status_3(tmp_path):
    """A disk of one page, mounted for this process alone; the encoder's own words are not repeated."""
    mounted = f"mount -t tmpfs -o size=4k tmpfs '{tmp_path}'"
    if subprocess.run(["unshare", "-rm", "sh", "-c", mounted], capture_output=True).returncode:
        pytest.skip("this machine lets nobody mount a disk")
    places = [str(tmp_path / name) for name in ("v.mp4", "v.gif")]
    script = f"{mounted} && '{sys.executable}' -c '{VIDEOS}' {' '.join(places)}; ls -A '{tmp_path}'"
    words = ["unshare", "-rm", "sh", "-c", script]
    result = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, timeout=600)
    assert result.stdout.split() == [str(terminal.OUTSIDE)] * 2, result.stderr
    said = [line for line in result.stderr.splitlines() if line and "compiles its" not in line]
    assert said == [f"cdpr-sim: {place}: cannot be written: No space left on device" for place in places]


def test_interrupt_is_130_wherever_it_comes(monkeypatch):
    """While working, while printing, in every command that works."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(cdpr, "solve", interrupted)
    assert run("solve", "cogiro").exit_code == 130
    monkeypatch.undo()
    monkeypatch.setattr(terminal.Output, "print", interrupted)
    assert run("solve", "cogiro").exit_code == 130


@pytest.mark.skipif(os.name == "nt", reason="Windows has no process groups to send an interrupt to")
def test_an_interrupt_is_130_even_where_a_shell_runs_the_tests_in_the_background():
    """``&`` has children ignore SIGINT: the test restores it, and cleans up whatever happens."""
    # Not while it imports: there Python ignores some interrupts.
    ready = "import cdpr_sim.cli, cdpr_sim.report.analysis_tables; import cdpr_sim as cdpr;"
    ready += "cdpr.find_equilibria(cdpr.load_robot('cogiro'), (0.4, 0.25, 0.2), starts=1)"
    running = subprocess.Popen(
        [sys.executable, "-c", f"{ready}; print('ready', flush=True); {COMMAND[2]}", "equilibria", "cogiro", *STARTS],
        env=ENVIRONMENT,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        assert running.stdout is not None
        assert running.stdout.readline() == "ready\n"
        time.sleep(0.3)  # the first starts
        assert running.poll() is None
        os.killpg(running.pid, signal.SIGINT)
        _, error = running.communicate(timeout=60)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)
        running.communicate()
    assert running.returncode == 130
    assert "Traceback" not in error


@pytest.mark.parametrize(
    "raised",
    [
        "raise KeyboardInterrupt",
        # As MuJoCo does: a module in C turns the interrupt of its own imports into an ImportError.
        """
            try: os.kill(os.getpid(), signal.SIGINT); time.sleep(9)
            except KeyboardInterrupt: raise ImportError('initialization failed') from None""",
    ],
)
def test_an_interrupt_while_importing_is_130_as_well(raised):
    """No traceback in the first second: importing MuJoCo and SciPy takes that long."""
    script = (
        "import os, signal, sys, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell may have it ignored
        "class Interrupt:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == 'typer': {raised}\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "from cdpr_sim.__main__ import main\n"
        "main()"
    )
    result = subprocess.run([sys.executable, "-c", script], env=ENVIRONMENT, capture_output=True, text=True, timeout=60)
    assert (result.returncode, result.stderr) == (130, "")


def test_help_says_what_each_exit_status_means():
    """And cuts no sentence."""
    text = " ".join(run("--help").stdout.split())
    assert "Exit status: 0 for success; 1 if" in text
    for status in ("2 for invalid input", "3 for system errors", "130 if interrupted"):
        assert status in text
    assert "..." not in text.replace("[ARGS]...", "")
    for name in COMMANDS:
        assert re.search(rf" {name} +[A-Z][^.]*", text), name


# ------------------------------------------------------------------------------------------------------------- TABLES


def test_a_narrow_terminal_gets_one_method_below_the_other():
    """Every number whole, none cut to ``4…``."""
    wide = run("settle", "parallel", columns=100).stdout
    for columns in (20, 40, 59):
        narrow = run("settle", "parallel", columns=columns).stdout
        assert "…" not in narrow
        assert set(re.findall(r"\d+\.\d{3,4}\b", wide)) == set(re.findall(r"\d+\.\d{3,4}\b", narrow))
        assert all(len(line) <= columns for line in narrow.splitlines())


@pytest.mark.parametrize("columns", [0, 1])
def test_a_terminal_without_width_gets_the_usual_one(columns):
    """With COLUMNS=0 nothing was printed, with status 0."""
    result = run("solve", "parallel", columns=columns)
    assert result.stdout == run("solve", "parallel").stdout
    assert "tilt" in result.stdout


@pytest.mark.parametrize(
    ("variable", "words", "sentence"),
    [
        ("MPLBACKEND", ["show", "parallel"], ""),
        ("MUJOCO_GL", ["settle", "parallel"], "MUJOCO_GL: found 'nonsense', which MuJoCo cannot use here, expected"),
    ],
)
def test_a_variable_of_a_library_with_nonsense_is_no_traceback(variable, words, sentence, tmp_path):
    """Pictures are files, for which no backend matters; MuJoCo cannot be imported, which is said in a sentence."""
    done = process(*words, env=ENVIRONMENT | {variable: "nonsense"}, cwd=tmp_path)
    if sentence:
        assert (done.returncode, done.stdout) == (2, "")
        one_sentence(done.stderr, sentence)
    else:
        assert (done.returncode, done.stderr) == (0, "")
        assert (tmp_path / "robot.png").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["sweep", "cogiro", "parallel", "--grid", "2", "1", "1"],
        ["check", "cogiro", "--grid", "2", "1", "1"],
        ["compensate", "cogiro"],
        ["sensitivity", "cogiro"],
        ["robots"],
        ["figures", "--list"],
    ],
    ids=lambda words: words[0],
)
def test_no_table_cuts_anything_at_40_columns(words):
    """Whatever it holds, row below row."""
    result = run(*words, columns=40)
    assert result.exit_code in (0, 1)
    assert "…" not in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 40


@pytest.fixture
def crane(tmp_path, catalogue) -> str:
    """A robot file whose robot is called as if it were markup."""
    robot, path = catalogue["parallel"], tmp_path / "crane.toml"
    cables = "".join(
        f"[[cables]]\nexit = {exit.tolist()}\nanchor = {anchor.tolist()}\n"
        for exit, anchor in zip(robot.exits, robot.anchors, strict=True)
    )
    path.write_text(
        'name = "crane [v2] [bold] $x"\naxial_stiffness = 1e4\n'
        f"[platform]\nmass = 0.4\nsize = [0.1, 0.04, 0.03]\n{cables}"
    )
    return str(path)


@pytest.mark.parametrize(
    "words",
    [
        ["settle"],
        ["solve"],
        ["compensate"],
        ["sensitivity"],
        ["equilibria", "--starts", "50"],
        ["sweep", "--grid", "2", "1", "1"],
        ["check", "--grid", "2", "1", "1"],
        ["map", "--points", "5", "-o", "map.png"],
        ["models", "-o", "models"],
    ],
    ids=lambda words: words[0],
)
def test_commands_print_a_name_as_it_is(crane, tmp_path, monkeypatch, words):
    """The whole name, brackets and all."""
    monkeypatch.chdir(tmp_path)
    release = cdpr.release
    monkeypatch.setattr(cdpr, "release", lambda one, seconds: release(one, seconds=seconds / 200))
    result = run(words[0], crane, *words[1:], columns=160)
    assert result.exit_code in (0, 1), result.output
    assert "crane [v2] [bold] $x" in result.stdout


def test_line_tables_keep_their_digits_and_headings():
    """227.5 mm printed as 228 beside 227.50 reads as half a millimetre of deviation."""
    robot = cdpr.load_robot("cogiro")
    settled = cdpr.settle_many(robot, [(0.2275, 0.25, 0.1), (0.6300, 0.25, 0.1)])
    agreements = [cdpr.compare(cdpr.solve(one.problem), one) for one in settled]
    text = printed(line_table("cogiro, vectran-0.7mm, z = 0.1 m", settled, agreements), 80)
    assert re.search(r"\b227\.50\b +227\.5\d\b", text)
    heading = text.partition("──")[0]
    for words in ("commanded", "dev.", "about y", "taut", "cables", "difference", "verdict"):
        assert words in heading
    assert "…" not in text


def test_large_errors_are_written_like_their_neighbours():
    """37.3 mm is no 3.73e+01; what six decimals would show as nothing keeps its size."""
    robot = cdpr.load_robot("parallel")
    found = cdpr.compensate(robot, (0.45, 0.25, 0.1))
    table = compensation_table(found, [cdpr.solve(robot, (0.2, 0.25, 0.1))], [found.equilibrium])
    row = list(table.columns[0].cells).index(r"position error \[mm]")
    before, after = (list(column.cells)[row] for column in table.columns[1:])
    assert re.fullmatch(r"\d+\.\d{6}", before)
    assert re.fullmatch(r"\d+\.\d{6}|\d\.\d\de-\d\d", after)


@pytest.mark.skipif(os.name == "nt", reason="folders are locked in another way")
@pytest.mark.parametrize(
    "words",
    [["map", "parallel", "-o"], ["check", "parallel", "-o"], ["sweep", "parallel", "-o"], ["video", "parallel", "-o"]],
    ids=lambda words: words[0],
)
def test_a_place_that_cannot_be_written_is_found_before_the_work(tmp_path, monkeypatch, words):
    """Root may write anywhere but where nothing can be written: /proc."""
    name = {"sweep": "x.zarr", "video": "x.mp4"}.get(words[0], "x.png")
    monkeypatch.setattr(cdpr, "check", None)
    monkeypatch.setattr(cdpr, "drive", None)
    monkeypatch.setattr("cdpr_sim.analysis.workspace.sweep.solve_many", None)
    result = run(*words, f"/proc/{name}")
    assert result.exit_code == 2, result.output
    one_sentence(result.stderr, "cannot be written")


def test_a_pose_may_be_written_with_commas():
    """The same pose."""
    usual = run("solve", "parallel", "--json", "--pose", "0.17", "0.25", "0.1")
    assert usual.exit_code == 0, usual.output
    for words in (["--pose", "0.17,0.25,0.1"], ["--pose", "0.17, 0.25, 0.1"], ["--pose=0.17,0.25,0.1"]):
        assert run("solve", "parallel", "--json", *words).stdout == usual.stdout


def test_an_implausible_robot_is_one_line_beside_the_answer(crane):
    """Not an error: the status and the table are as ever."""
    path = Path(crane)
    path.write_text(path.read_text().replace("1e4", "1.0"))
    result = run("solve", crane)
    assert result.exit_code in (0, 2)
    warned = [line for line in result.stderr.splitlines() if "warning" in line]
    assert len(warned) == 1
    assert warned[0].startswith("cdpr-sim: warning: crane [v2] [bold] $x: found cables that stretch by 49% or more")
    assert not run("solve", "parallel").stderr.strip()


def test_a_pose_outside_the_frame_is_one_line_beside_the_answer():
    """Both methods agree that the platform hangs 0.7 m below the floor, and it is hardly meant."""
    result = run("settle", "ipanema-2", "--pose", "5", "5", "1")
    assert result.exit_code == 0, result.output
    assert result.stderr.count("cdpr-sim: warning: ipanema-2: found a commanded position beside or above") == 1


def test_a_store_that_is_none_is_refused_in_a_sentence(tmp_path):
    """A pipe, which would never end, a text, half a store: no word of NumPy's or of zip files."""
    pipe, text, half = (tmp_path / name for name in ("pipe.npz", "text.npz", "half.npz"))
    os.mkfifo(pipe)
    text.write_text("no store")
    np.savez(half, identity="x", done=1, members=np.zeros(1000), history=np.zeros(3))
    half.write_bytes(half.read_bytes()[:-300])
    for path in (pipe, text, half):
        with pytest.raises(cdpr.InvalidInput, match=r"npz: found a (file|folder, a pipe)"):
            search._resumed(path, "x")


def test_a_pipe_as_a_file_is_refused_and_not_waited_for(tmp_path):
    """Robots, other projects' files, measurements, answers, stores of proofs; a pipe that is written to is read."""
    pipes = [tmp_path / f"pipe{suffix}" for suffix in (".toml", ".json", ".csv")]
    for pipe in pipes:
        os.mkfifo(pipe)
    toml, answers, csv = map(str, pipes)
    for words in (("show", toml), ("settle", answers), ("identify", "parallel", csv), ("score", answers)):
        ended = (
            process(*words, "--problems", str(tmp_path), timeout=60)
            if words[0] == "score"
            else process(*words, timeout=60)
        )
        assert (ended.returncode, "found a pipe" in ended.stderr or "no such file" in ended.stderr) == (2, True), (
            ended.stderr
        )
    writer = subprocess.Popen(["sh", "-c", f"cat > {csv}"], stdin=subprocess.PIPE, text=True)
    reading = os.open(csv, os.O_RDONLY | os.O_NONBLOCK)  # until the command has opened it
    writer.stdin.write("commanded_x [mm],commanded_y [mm],commanded_z [mm],measured_z [mm]\n400,250,100,99.5\n")
    writer.stdin.close()
    writer.wait()
    assert len(cdpr.read_measurements(csv)) == 1
    os.close(reading)


def test_force_writes_to_where_a_link_points(tmp_path, monkeypatch):
    """The link stays, and the file behind it is replaced, whichever folder it is in; links in a circle are refused."""
    monkeypatch.chdir(tmp_path)
    Path("there").mkdir()
    Path("there/robot.toml").write_text("old")
    Path("link.toml").symlink_to("there/robot.toml")
    Path("dangling.toml").symlink_to("there/new.toml")
    Path("lost.toml").symlink_to("nowhere/new.toml")
    Path("circle.toml").symlink_to("circle.toml")
    assert run("new", "link", "--force").exit_code == 0
    assert run("new", "dangling").exit_code == 0
    assert Path("link.toml").is_symlink()
    for name in ("robot", "new"):
        cdpr.load_robot(f"there/{name}.toml")
    for name in ("lost", "circle"):
        refused = run("new", name, "--force")
        assert (refused.exit_code, "expected" in refused.stderr) == (2, True), refused.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("settle parallel --mass 1e11", "mass: found 1e+11 kg, a load of 1e+08 times the axial stiffness"),
        ("solve parallel --wrench 0,0,-1e9,0,0,0", "external_wrench: found 1e+09 N, a load of 1e+05 times"),
        ("settle stiff.toml", "axial_stiffness: found 1e+15 N, which a load of 3.92 N strains by 4e-15, expected"),
    ],
)
def test_loads_and_stiffnesses_that_no_method_can_compute_are_named(words, said, tmp_path, monkeypatch):
    """What was given is named, not the pose; and within the range both methods find the equilibrium."""
    monkeypatch.chdir(tmp_path)
    robot = cdpr.load_robot("parallel")
    Path("stiff.toml").write_text(as_toml(robot.replace(axial_stiffness=1e15)))
    told = run(*words.split())
    assert (told.exit_code, said in " ".join(told.stderr.split())) == (2, True), told.stderr
    for strain in (1e-8, 1.0):
        at = robot.replace(axial_stiffness=robot.weight / strain), (0.3, 0.25, 0.1)
        assert cdpr.compare(cdpr.solve(*at), cdpr.settle(*at)).agrees


def test_errors_of_files_have_the_words_of_this_package(tmp_path):
    """Whatever pydantic objects to; a sentence with what is expected, and none of its own phrases."""
    wrong = ["mass = inf", "mass = 'heavy'", "mass = [1]", "mass = true"]
    changes = [("mass = 0.4", one) for one in wrong]
    for one in (
        "reeving = 'two'", "units = 3", "stiffening = 1", "stiffening = [1, 2, 3]", "hysteresis = [1]", "pulley = 1",
        "pulley = { radius = 0.1, axis = 'z' }", "linear_density = []", "description = 1",
    ):  # fmt: skip
        changes.append(('name = "parallel"', f'name = "x"\n{one}'))
    file = tmp_path / "wrong.toml"
    words = as_toml(cdpr.load_robot("parallel").replace(description=""))
    for old, new in changes:
        file.write_text(words.replace(old, new, 1))
        with pytest.raises(cdpr.RobotFileError, match=r"found .*, expected ") as refused:
            cdpr.load_robot(file)
        assert not re.search("Input|should|valid|instance", str(refused.value)), refused.value


def test_a_search_that_cannot_fit_is_refused():
    """Each pose in each layout of a generation: the estimate is made where the layouts are solved."""
    robot = cdpr.load_robot("parallel")
    space = Space.of(robot, [cdpr.Move("exits", 0.05)])
    many = Cases.of(robot, np.broadcast_to([0.3, 0.25, 0.1], (1_000_000, 3)))
    crowd = space.layouts(np.zeros((20_000, len(space))))
    with pytest.raises(cdpr.InvalidInput, match="poses: 1,000,000 of them in each of 20,000 layouts would take about"):
        solve_layouts(crowd, many)
