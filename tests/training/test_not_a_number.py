"""A loss that stops being a number ends the training with its name; checkpoints stay finite, and it goes on from them.
"""
import shutil
import sys

import runs

STEPS = 24


def spoil(run, folder, sets, *words):
    """Resumes under settings that no training survives."""
    before, _ = runs.newest(run)
    code, _, errors = runs.ars(*runs.train_arguments(run, None, sets))
    sentence = runs.failed(code, errors, "step", *words)
    print(sentence)
    step, checkpoint = runs.newest(run)
    assert step >= before and f"the checkpoint of step {step} is intact" in sentence, (before, step, sentence)
    told = runs.status(run)
    assert told["state"] == "failed" and told["error"] == sentence.removeprefix("error: "), told
    for found in runs.checkpoints(run).values():
        runs.expect_finite(found)
    runs.expect_opens(checkpoint, folder)


def main():
    capture = runs.capture()
    with runs.Folder() as folder:
        run = folder / "run"
        first = runs.stopped_early(run, capture, runs.SMALL)
        # Rates that send the networks, then the surfels' own values, where no float follows; also with a checkpoint
        # after every step, so that one is written as late as can be.
        spoil(run, folder, ("schedule.network_rate=1e30", "schedule.network_rate_pbr=1e30", "run.checkpoint_steps=100"))
        assert runs.newest(run)[0] == first
        spoil(run, folder, ("schedule.network_rate=2e-3", "schedule.network_rate_pbr=2e-3", "schedule.base_rate=1e38",
                            "run.checkpoint_steps=1"))
        # The step that did the damage may have been saved before a loss told of it: finite, but no place to go on from.
        for step, checkpoint in runs.checkpoints(run).items():
            if step > first:
                shutil.rmtree(checkpoint)
        runs.succeed(*runs.train_arguments(run, None, ("schedule.base_rate=5e-3", "run.checkpoint_steps=4")))
        assert [row["step"] for row in runs.rows(run)] == list(range(1, STEPS + 1))
        runs.expect_finite(runs.newest(run)[1])


if __name__ == "__main__":
    sys.exit(main())
