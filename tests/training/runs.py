"""Runs `ars train` as a person or a failing machine does, and looks at what it leaves.

Standard library alone. Nothing here depends on how fast the machine is: scripts wait for what a run says of itself, and
the limits of these waits are there only so that a run that hangs fails.
"""
import array
import json
import math
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

PATIENCE_S = 400
FLOATS = {"F32": "f", "F64": "d"}

# Two stages of the smallest preset on a quarter of the pictures' size: a step takes a moment, and every part has its
# turn.
SMALL = ("schedule.radiance_steps=12", "schedule.pbr_steps=12", "schedule.image_scale=4",
         "occlusion.interactive_directions=16", "network.max_channels=8", "run.checkpoint_steps=4",
         "run.preview_steps=0")


def capture():
    """The shared capture; ends the script (NOT RUN, or a failure where data are demanded) when it is not there."""
    data = os.environ.get("ARS_TEST_DATA")
    folder = pathlib.Path(data or "/nowhere") / "capture" / "casual"
    if folder.is_dir():
        return folder
    not_run("needs the test data capture/casual (ARS_TEST_DATA)")


def not_run(why):
    print(f"NOT RUN: {pathlib.Path(sys.argv[0]).stem}: {why}", flush=True)
    sys.exit(1 if os.environ.get("ARS_REQUIRE_DATA") == "1" else 0)


started = []


class Folder:
    """A temporary folder; kept and named when the script fails. Nothing goes on in it afterwards."""

    def __enter__(self):
        self.path = pathlib.Path(tempfile.mkdtemp(prefix="ars-training-"))
        return self.path

    def __exit__(self, kind, value, trace):
        for process in started:
            if process.poll() is None:
                process.kill()
                process.wait()
        if kind is None or issubclass(kind, SystemExit) and value.code in (0, None):
            shutil.rmtree(self.path, ignore_errors=True)
        else:
            print(f"kept: {self.path}", file=sys.stderr)


def command(*arguments):
    return [os.environ["ARS_PROGRAM"], *map(str, arguments)]


def settings(*values):
    return [word for value in values for word in ("--set", value)]


def train_arguments(run, source=None, sets=()):
    """Of a new run on `source`, or without one of a run that is resumed."""
    begin = ["--resume"] if source is None else ["--capture", source, "--preset", "tiny"]
    return ["train", "--run", run, *begin, *settings(*sets)]


def start(*arguments, **options):
    """A process that goes on; its words go to files, since nobody reads a pipe meanwhile."""
    words = tempfile.TemporaryFile()
    process = subprocess.Popen(command(*arguments), stdout=words, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                               **options)
    process.words = words
    started.append(process)
    return process


def words_of(process):
    process.words.seek(0)
    return process.words.read().decode(errors="replace")


def ended(process):
    """Exit code as Python has it: negative for a signal."""
    try:
        return process.wait(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        raise AssertionError(f"still at work after {PATIENCE_S} s: {words_of(process)[-2000:]}") from None


def ars(*arguments, **options):
    """The program to its end: code, standard output, standard error."""
    result = subprocess.run(command(*arguments), capture_output=True, text=True, errors="replace", timeout=PATIENCE_S,
                            stdin=subprocess.DEVNULL, **options)
    return result.returncode, result.stdout, result.stderr


def succeed(*arguments, **options):
    code, output, errors = ars(*arguments, **options)
    assert code == 0, f"{arguments} ended with {code}: {output[-2000:]}{errors[-2000:]}"
    return output


def wait_for(what, condition, process=None):
    end = time.monotonic() + PATIENCE_S
    while True:
        found = condition()
        if found:
            return found
        if process is not None and process.poll() is not None:
            raise AssertionError(f"the program ended ({process.returncode}) before {what}: {words_of(process)[-2000:]}")
        assert time.monotonic() < end, f"waited {PATIENCE_S} s for {what}"
        time.sleep(0.01)


def last_line(text):
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""


def failed(code, text, *words):
    """A failure as it should be: exit code 1, at last one sentence that holds every word. Returns the sentence."""
    sentence = last_line(text)
    assert code == 1, f"expected exit code 1, found {code}: {text[-2000:]}"
    assert sentence.startswith("error: "), f"expected a sentence, found: {text[-2000:]}"
    for word in words:
        assert word in sentence, f'no "{word}" in: {sentence}'
    return sentence


def stopped_early(run, source, sets):
    """A new run that was stopped in its first steps, at the step returned. By a signal: it is there at once, however
    many steps of a fast machine go into the start of a program that would ask for it."""
    process = start(*train_arguments(run, source, sets))
    wait_for("a checkpoint", lambda: newest(run)[0] >= 4, process)
    process.send_signal(signal.SIGTERM)
    assert ended(process) == -signal.SIGTERM, words_of(process)
    return newest(run)[0]


# --- what lies in a run's folder
def status(run):
    try:
        return json.loads((run / "status.json").read_text())
    except (OSError, ValueError):
        return {"state": "", "step": 0}


def rows(run):
    """Whole lines of metrics.jsonl."""
    try:
        text = (run / "metrics.jsonl").read_text()
    except OSError:
        return []
    return [json.loads(line) for line in text.splitlines(keepends=True) if line.endswith("\n")]


def checkpoints(run):
    """Complete ones, {step: folder}."""
    found = {int(p.parent.name): p.parent for p in run.glob("checkpoints/*/complete.json") if p.parent.name.isdigit()}
    return dict(sorted(found.items()))


def newest(run):
    """(step, folder) of the newest checkpoint, or (0, None)."""
    found = checkpoints(run)
    return next(reversed(found.items())) if found else (0, None)


def tensors(path):
    """{name: (type, shape, bytes)} of a safetensors file; a file that is cut is a failure."""
    blob = path.read_bytes()
    assert len(blob) >= 8, f"{path} is cut"
    size = struct.unpack("<Q", blob[:8])[0]
    header = json.loads(blob[8:8 + size])
    found, end = {}, 0
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        a, b = entry["data_offsets"]
        end = max(end, b)
        found[name] = (entry["dtype"], entry["shape"], blob[8 + size + a:8 + size + b])
    assert len(blob) == 8 + size + end, f"{path} has {len(blob)} bytes, its header says {8 + size + end}"
    return found


def state(checkpoint):
    """All tensors of a checkpoint: weights, optimiser, light, radii."""
    found = {}
    for file in ("weights.safetensors", "trainer.safetensors"):
        for name, tensor in tensors(checkpoint / file).items():
            found[f"{file}:{name}"] = tensor
    for part in ("weights.safetensors:", "trainer.safetensors:light.log", "trainer.safetensors:radius_offsets"):
        assert any(name.startswith(part) for name in found), f"no {part} in {checkpoint}"
    return found


def expect_finite(checkpoint):
    for name, (kind, _, blob) in state(checkpoint).items():
        values = array.array(FLOATS[kind]) if kind in FLOATS else None
        if values is None:
            continue
        values.frombytes(blob)
        assert all(map(math.isfinite, values)), f"{name} of {checkpoint} holds a number that is none"


def losses(run):
    """{step: what the step gave}: losses and radii; times and memory are the machine's."""
    return {row["step"]: {k: v for k, v in row.items() if k.startswith(("loss.", "rate.", "radius.")) or k == "stage"}
            for row in rows(run)}


def expect_same_numbers(run, whole, steps):
    """Bit for bit: the last checkpoint's tensors and every row's numbers."""
    assert [row["step"] for row in rows(run)] == list(range(1, steps + 1)), "a row is missing or comes twice"
    ours, theirs = losses(run), losses(whole)
    for step in range(1, steps + 1):
        assert ours[step] == theirs[step], f"row {step}: {ours[step]} is not {theirs[step]}"
    assert newest(run)[0] == newest(whole)[0] == steps
    ours, theirs = state(newest(run)[1]), state(newest(whole)[1])
    assert ours.keys() == theirs.keys()
    different = [name for name in ours if ours[name] != theirs[name]]
    assert not different, f"{len(different)} of {len(ours)} tensors differ, the first: {different[0]}"
    return len(ours)


def expect_opens(avatar, folder):
    """An avatar (a checkpoint, a run) is rendered: a tiny picture."""
    out = folder / "opened"
    shutil.rmtree(out, ignore_errors=True)
    succeed("render", "--avatar", avatar, "--size", "32x32", "--light-size", "64", "--device", "cpu", "--quiet",
            "--out", out)
    assert any(out.glob("*.png")), f"no picture of {avatar}"
    shutil.rmtree(out)


def restored_at(run):
    """Steps at which the log says that a checkpoint was restored, in order."""
    mark = "restored the checkpoint of step "
    return [int(line.split(mark)[1]) for line in (run / "log.txt").read_text().splitlines() if mark in line]


def expect_none_broken(run):
    broken = [p.name for p in run.glob("checkpoints/*.broken*")]
    assert not broken, f"checkpoints that did not restore: {broken}"


class standing_still:
    """A process does nothing while the block changes the world around it, however slow the machine is."""

    def __init__(self, process):
        self.process = process

    def __enter__(self):
        self.process.send_signal(signal.SIGSTOP)

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGCONT)


def kill(process):
    """SIGKILL; whether it was still at work."""
    process.send_signal(signal.SIGKILL)
    return ended(process) == -signal.SIGKILL
