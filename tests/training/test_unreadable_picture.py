"""A picture that breaks while a training runs is named; the checkpoint stays, and with the picture mended it goes on.
"""
import os
import sys

import runs

STEPS = 28
# Whole pictures, so that a few of them are more than the smallest cache holds and every one is read again and again.
SETS = ("schedule.radiance_steps=26", "schedule.pbr_steps=2", "schedule.image_scale=1", "schedule.crop_margin=-1",
        "run.cache_megabytes=16", "occlusion.interactive_directions=16", "network.max_channels=8",
        "run.checkpoint_steps=2", "run.preview_steps=0", "data.frames=0:8")


def linked_capture(source, folder):
    """The capture under other names: folders of its own, files that are links."""
    for path in sorted(source.rglob("*")):
        copy = folder / path.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            copy.mkdir(exist_ok=True)
        else:
            copy.symlink_to(path.resolve())


def replace(path, blob):
    """In one move, as a program that writes pictures should."""
    other = path.with_name(path.name + ".new")
    other.write_bytes(blob)
    os.replace(other, path)


def main():
    source = runs.capture()
    with runs.Folder() as folder:
        capture, run = folder / "capture", folder / "run"
        linked_capture(source, capture)
        whole = folder / "whole"
        runs.succeed(*runs.train_arguments(whole, capture, SETS))
        process = runs.start(*runs.train_arguments(run, capture, SETS))
        runs.wait_for("a checkpoint", lambda: runs.newest(run)[0] >= 4, process)
        # Half of every picture of a frame, so that the next step with that frame meets one, whatever camera it takes.
        broken = {p: p.read_bytes() for p in sorted(capture.glob("2*/00000003.jpg"))}
        assert len(broken) == 12, broken
        with runs.standing_still(process):
            for path, blob in broken.items():
                replace(path, blob[:len(blob) // 2])
        code = runs.ended(process)
        sentence = runs.failed(code, runs.words_of(process), "00000003.jpg", "broken JPEG", "is intact")
        print(sentence)
        assert any(str(path) in sentence for path in broken), sentence
        step, checkpoint = runs.newest(run)
        assert 4 <= step < STEPS and f"the checkpoint of step {step} is intact" in sentence, (step, sentence)
        assert runs.status(run)["state"] == "failed"
        runs.expect_finite(checkpoint)
        runs.expect_opens(checkpoint, folder)
        # Before it is mended a resume says the same, before it begins or at the step; nothing is lost.
        code, _, errors = runs.ars(*runs.train_arguments(run))
        print(runs.failed(code, errors, "00000003.jpg"))
        assert runs.newest(run)[0] >= step
        for path, blob in broken.items():
            replace(path, blob)
        runs.succeed(*runs.train_arguments(run))
        runs.expect_same_numbers(run, whole, STEPS)


if __name__ == "__main__":
    sys.exit(main())
