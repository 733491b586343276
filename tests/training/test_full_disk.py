"""A disk that fills ends a training with a sentence and leaves its last checkpoint; with room again it goes on."""
import shutil
import subprocess
import sys

import runs

STEPS = 24


class Disk:
    """A small disk of its own (tmpfs); None where mounting is refused."""

    def __init__(self, path, size):
        self.path = path
        path.mkdir()
        made = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "ars-test", str(path)],
                              capture_output=True, text=True)
        if made.returncode != 0:
            runs.not_run(f"needs the right to mount a small tmpfs: {made.stderr.strip()}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        subprocess.run(["umount", "-l", str(self.path)], check=True)

    def fill(self, leave=0):
        """Another program's file takes the room."""
        with open(self.path / "other", "ab") as file:
            while shutil.disk_usage(self.path).free > leave:
                try:
                    file.write(b"o" * min(1 << 16, shutil.disk_usage(self.path).free - leave))
                    file.flush()
                except OSError:
                    break

    def empty(self):
        (self.path / "other").unlink()


def folder_bytes(folder):
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())


def expect_told(run, sentence, step):
    """status.json and the log say the same, and of a checkpoint what is true."""
    told = runs.status(run)
    assert told["state"] == "failed" and told["error"] in sentence, told
    assert told["process"] == 0
    which = f"the checkpoint of step {step} is intact" if step else "there is no earlier checkpoint"
    assert which in sentence, sentence
    assert "failed: " in (run / "log.txt").read_text()
    assert runs.newest(run)[0] == step
    left = [p.name for p in run.glob("checkpoints/*") if not p.name.isdigit()]
    assert not left, f"half written and left: {left}"


def first_checkpoint(disk, capture, bytes_of_one):
    """No room for the very first checkpoint: the write itself fails."""
    disk.fill(bytes_of_one // 2)
    run = disk.path / "first"
    code, _, errors = runs.ars(*runs.train_arguments(run, capture, runs.SMALL))
    sentence = runs.failed(code, errors, "disk full")
    print(sentence)
    expect_told(run, sentence, 0)
    disk.empty()
    shutil.rmtree(run)


def later_checkpoint(disk, capture, whole, folder):
    """Room ends while it runs, after the checkpoint of step 4."""
    run = disk.path / "later"
    process = runs.start(*runs.train_arguments(run, capture, runs.SMALL + ("run.checkpoints_kept=1",)))
    runs.wait_for("a checkpoint", lambda: runs.newest(run)[0] >= 4, process)
    with runs.standing_still(process):
        disk.fill()
    code = runs.ended(process)
    sentence = runs.failed(code, runs.words_of(process))
    print(sentence)
    assert any(words in sentence for words in ("not enough disk", "disk full", "No space left")), sentence
    step = runs.newest(run)[0]
    assert 4 <= step < STEPS, step
    expect_told(run, sentence, step)
    runs.expect_opens(run, folder)
    code, _, errors = runs.ars(*runs.train_arguments(run))
    print(runs.failed(code, errors))
    assert runs.newest(run)[0] == step, "a resume without room cost the checkpoint"
    disk.empty()
    runs.succeed(*runs.train_arguments(run))
    runs.expect_none_broken(run)
    runs.expect_same_numbers(run, whole, STEPS)


def main():
    capture = runs.capture()
    with runs.Folder() as folder:
        whole = folder / "whole"
        runs.succeed(*runs.train_arguments(whole, capture, runs.SMALL))
        one = folder_bytes(runs.newest(whole)[1])
        with Disk(folder / "disk", 4 * one) as disk:
            first_checkpoint(disk, capture, one)
            later_checkpoint(disk, capture, whole, folder)


if __name__ == "__main__":
    sys.exit(main())
