"""A training that is refused memory says so, whenever that is; the checkpoint stays, and without the limit it goes on.
"""
import resource
import shutil
import signal
import sys
import time

import runs

STEPS = 24


def address_space(process):
    """Bytes that the process has mapped now, and the most so far; 0 once it is gone."""
    try:
        lines = open(f"/proc/{process.pid}/status").read().splitlines()
    except OSError:
        return 0, 0
    found = {line.split(":")[0]: int(line.split()[1]) * 1024 for line in lines if line.startswith(("VmSize", "VmPeak"))}
    return found.get("VmSize", 0), found.get("VmPeak", 0)


def copy_of(run, folder, name):
    """Each trial works on a copy, so that one that goes through costs the others nothing."""
    trial = folder / name
    shutil.copytree(run, trial)
    return trial


def expect_named(process, trial, step, what):
    """A training that is out of memory ends by itself, with the reason, with its checkpoint. False where it did not run
    out of it, but ended as it should."""
    code, text = runs.ended(process), runs.words_of(process)
    newest, checkpoint = runs.newest(trial)
    if code == 0:
        print(f"{what}: went through", flush=True)
        assert newest == STEPS
        return False
    if code in (-signal.SIGSEGV, -signal.SIGBUS, -signal.SIGABRT):
        # LibTorch does not look everywhere whether it was given memory.
        sentence = runs.last_line(text)
        assert "refused" in sentence and "--resume" in sentence, f"ended by signal {-code}: {text[-2000:]}"
    else:
        sentence = runs.failed(code, text)
    print(f"{what}: {sentence}", flush=True)
    assert "memory" in sentence, sentence
    assert newest >= step
    runs.expect_finite(checkpoint)
    # Half of a checkpoint is no checkpoint; what stands there is taken away by the next resume at the latest.
    told = runs.status(trial)
    if told["state"] == "failed":
        # It may have failed with its reason and then broken off before it could say so.
        assert told["error"] in sentence or "broke off" in sentence and "memory" in told["error"], (told, sentence)
    return True


def limited_at_start(trial, step, limit, what):
    """The limit stands before the program starts, as with `ulimit -v`."""
    bound = lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
    return expect_named(runs.start(*runs.train_arguments(trial), preexec_fn=bound), trial, step, what)


def limited_at_work(trial, step, state, rows, what):
    """The limit comes in the middle: from some moment on nothing more is given."""
    process = runs.start(*runs.train_arguments(trial))
    runs.wait_for(state, lambda: runs.status(trial).get("process") == process.pid and
                  (state == "loading" or runs.status(trial)["state"] in (state, "saving")) and
                  (rows == 0 or len(runs.rows(trial)) >= rows), process)
    with runs.standing_still(process):
        # A little is left: a stack that may not grow by a page is no error that a program can tell of.
        size, _ = address_space(process)
        resource.prlimit(process.pid, resource.RLIMIT_AS, (size + (4 << 20), resource.getrlimit(resource.RLIMIT_AS)[1]))
    return expect_named(process, trial, step, what)


def main():
    capture = runs.capture()
    with runs.Folder() as folder:
        whole, run = folder / "whole", folder / "run"
        process = runs.start(*runs.train_arguments(whole, capture, runs.SMALL))
        peak = 0
        while process.poll() is None:
            peak = max(peak, address_space(process)[1])
            time.sleep(0.02)
        assert runs.ended(process) == 0, runs.words_of(process)
        print(f"address space of the whole run: {peak / 1e6:.0f} MB at most", flush=True)

        step = runs.stopped_early(run, capture, runs.SMALL)
        assert step < STEPS - 8, f"stopped at step {step}, expected to be early in the run"

        # In steps of about one thread's stack and a half: whatever is refused first has its turn.
        shares = range(30, 100, 2)
        refused = [trial for share in shares
                   if limited_at_start(trial := copy_of(run, folder, f"start{share}"), step, peak * share // 100,
                                       f"{share} % of it")]
        assert len(refused) >= len(shares) // 2, f"only {len(refused)} of {len(shares)} limits were felt"
        late = [trial for state, rows in (("loading", 0), ("running", 0), ("running", step + 2))
                if limited_at_work(trial := copy_of(run, folder, f"{state}{rows}"), step, state, rows,
                                   f"no more while {state}, {rows} rows")]
        assert len(late) >= 2, f"only {len(late)} of 3 limits at work were felt"

        for trial in (refused[-1], late[-1]):
            runs.expect_opens(trial, folder)
            runs.succeed(*runs.train_arguments(trial))
            runs.expect_none_broken(trial)
            runs.expect_same_numbers(trial, whole, STEPS)


if __name__ == "__main__":
    sys.exit(main())
