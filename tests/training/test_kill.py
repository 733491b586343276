"""A training that is killed at twenty random moments and resumed each time ends in the numbers of one that was not."""
import random
import sys
import time

import runs

STEPS = 24
KILLS = 20
SEED = 20


def last_row(run):
    found = runs.rows(run)
    return found[-1]["step"] if found else 0


def wait_while_loading(process, run, chance, longest_s):
    """Somewhere between the start of the program and the end of its loading, if that lasts so long."""
    if chance.random() < 0.3:
        time.sleep(chance.uniform(0, 0.1))
        return
    runs.wait_for("loading", lambda: runs.status(run).get("process") == process.pid, process)
    time.sleep(chance.uniform(0, longest_s))


def wait_in_step(process, run, step, chance, step_s):
    """Anywhere in the step after `step`."""
    # Until the run goes on, rows of steps that are to be done again may stand there.
    runs.wait_for("the first step", lambda: runs.status(run).get("process") == process.pid and
                  runs.status(run)["state"] in ("running", "saving"), process)
    runs.wait_for(f"step {step}", lambda: last_row(run) >= step, process)
    time.sleep(chance.uniform(0, step_s))


def wait_in_save(process, run, after, chance):
    """While a checkpoint later than `after` is written, synced or renamed: its folder is there under another name."""
    def partial():
        return [p for p in run.glob("checkpoints/*.partial") if int(p.stem) > after]
    runs.wait_for("a checkpoint that is being written", lambda: partial() or runs.newest(run)[0] > after, process)
    if chance.random() < 0.5:
        time.sleep(chance.uniform(0, 0.05))
    else:  # its last file: what follows is the sync and the rename
        runs.wait_for("a whole checkpoint", lambda: runs.newest(run)[0] > after or
                      any((p / "complete.json").exists() for p in partial()), process)


def whole_run(folder, capture):
    """The uninterrupted run; how long loading and a step take here."""
    run = folder / "whole"
    begin = time.monotonic()
    process = runs.start(*runs.train_arguments(run, capture, runs.SMALL))
    runs.wait_for("the first step", lambda: runs.status(run)["state"] == "running", process)
    load_s = time.monotonic() - begin
    code = runs.ended(process)
    assert code == 0, runs.words_of(process)[-2000:]
    times = sorted(row["time.step_ms"] for row in runs.rows(run))
    return run, load_s, 1e-3 * times[len(times) // 2]


def killed_run(folder, capture, load_s, step_s):
    """Kills and resumes; what the kills met."""
    run, chance = folder / "killed", random.Random(SEED)
    # Every fifth kill while loading, every fourth while saving, the others in steps that are spread over the whole run.
    targets = sorted(chance.randrange(1, STEPS - 3) for _ in range(KILLS))
    met = {"killed": 0, "loading": 0, "saving": 0, "steps": 0, "after_checkpoint": 0, "redone": 0}
    opened = set()
    # Loading is quicker than it was the first time: a kill that came after it is owed again, with less patience.
    owed, longest_s = 0, 0.5 * min(load_s, 1.0)
    for i in range(KILLS):
        owed += i % 5 == 0
        for_loading = owed > 0
        resumable = (run / "config.json").exists()
        restores = newest = runs.newest(run)[0] if resumable else 0
        if newest == STEPS:
            break
        process = runs.start(*(runs.train_arguments(run) if resumable else
                               runs.train_arguments(run, capture, runs.SMALL)))
        if for_loading:
            wait_while_loading(process, run, chance, longest_s)
        elif i % 4 == 2 and newest < STEPS - 8:
            wait_in_save(process, run, newest, chance)
        else:
            wait_in_step(process, run, min(STEPS - 2, max(targets[i], newest + 1 + i % 3)), chance, step_s)
        with runs.standing_still(process):  # what it says of itself is what the kill meets
            told, step = runs.status(run), last_row(run)
            at_work = runs.kill(process)
        state = told["state"] if told.get("process") == process.pid else ""  # else the words of the one before
        if for_loading and at_work and state in ("", "loading"):
            owed -= 1
        elif for_loading:
            longest_s /= 4
        if not at_work:
            assert process.returncode == 0, runs.words_of(process)[-2000:]
            print(f"kill {i} came too late: the training had ended", flush=True)
            continue
        met["killed"] += 1
        met["saving" if state in ("saving", "stopping") else "steps" if state == "running" else "loading"] += 1
        if not (run / "config.json").exists():
            continue
        newest, checkpoint = runs.newest(run)
        assert newest >= restores, f"the checkpoint of step {restores} was lost"
        if checkpoint:
            met["after_checkpoint"] += 1
            runs.state(checkpoint)
            if newest not in opened:
                runs.expect_opens(checkpoint, folder)
                opened.add(newest)
        met["redone"] += 1 if state == "running" and step > newest else 0
        print(f"kill {i}: {state or 'starting'}, step {step}, newest checkpoint {newest}", flush=True)
    runs.succeed(*runs.train_arguments(run))
    return run, met, opened


def main():
    capture = runs.capture()
    with runs.Folder() as folder:
        whole, load_s, step_s = whole_run(folder, capture)
        run, met, opened = killed_run(folder, capture, load_s, step_s)
        print(f"loading {load_s:.2f} s, a step {step_s:.3f} s; kills: {met}; checkpoints opened: {sorted(opened)}")
        assert met["killed"] >= KILLS - 4, "too few kills came before the end"
        assert met["after_checkpoint"] >= 12, "too few kills came after the first checkpoint"
        assert met["redone"] >= 5, "too few kills cost work that was done again"
        assert met["loading"] >= 2 and met["saving"] >= 2 and met["steps"] >= 6, "kills must meet every part of a run"
        runs.expect_none_broken(run)
        restored = runs.restored_at(run)
        assert restored == sorted(restored), f"a resume went back behind an earlier one: {restored}"
        count = runs.expect_same_numbers(run, whole, STEPS)
        print(f"{count} tensors and {STEPS} rows of metrics are those of the uninterrupted run, bit for bit")


if __name__ == "__main__":
    sys.exit(main())
