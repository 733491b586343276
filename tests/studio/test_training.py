"""Starts, pauses and resumes a small training from the panel, leaves the window and finds the run again."""
import json
import os
import pathlib
import sys
import tempfile
import time

from driver import PATIENCE, Studio

PANEL = "//Training/**/"


def status(run):
    try:
        return json.loads((run / "status.json").read_text())
    except (OSError, ValueError):
        return {"state": "", "step": 0}


def wait_for(what, condition, seconds):
    end = time.time() + seconds
    while time.time() < end:
        if condition():
            return
        time.sleep(0.1)
    raise AssertionError(f"waited {seconds} s for {what}")


def fill(studio, item, text):
    studio.click(PANEL + item)
    studio.key("ctrl+a")
    studio.type(text)


def press(studio, label):
    """A button that appears once the panel has read what the run says."""
    end = time.time() + PATIENCE
    while not studio.ask([PANEL + label])["items"][PANEL + label]:
        assert time.time() < end, f"no button {label}"
        time.sleep(0.2)
    studio.click(PANEL + label)


def main(pictures):
    data = os.environ.get("ARS_TEST_DATA")
    capture = pathlib.Path(data or "") / "capture" / "casual"
    if not data or not capture.exists():
        print("NOT RUN: no capture; set ARS_TEST_DATA")
        return
    folder = pathlib.Path(tempfile.mkdtemp(prefix="ars-training-"))
    run = folder / "casual-tiny"
    with Studio(folder=folder / "first", size="1280x1180") as studio:
        studio.show("Training")
        fill(studio, "Capture", str(capture))
        fill(studio, "Run", str(run))
        studio.click(PANEL + "tiny")
        press(studio, "Start")
        wait_for("the first steps", lambda: status(run)["state"] == "running" and status(run)["step"] > 3, PATIENCE)
        press(studio, "Pause")
        wait_for("the pause", lambda: status(run)["state"] == "paused", PATIENCE)
        paused = status(run)["step"]
        time.sleep(2)
        assert status(run)["step"] == paused, "a paused run went on"
        if pictures:
            studio.screenshot(pictures / "studio-training.png")
        press(studio, "Resume")
        wait_for("more steps", lambda: status(run)["state"] == "running" and status(run)["step"] > paused, PATIENCE)

    # The window is gone, the run is not.
    left = status(run)["step"]
    wait_for("steps without a window", lambda: status(run)["step"] > left, PATIENCE)
    with Studio(folder=folder / "first", size="1280x1180") as studio:
        studio.show("Training")
        press(studio, "Stop")
        wait_for("the end", lambda: status(run)["state"] not in ("running", "stopping", "saving"), PATIENCE)
        assert list((run / "checkpoints").glob("*/complete.json")), "no checkpoint after a stop"
        press(studio, "Open avatar")
        studio.wait(lambda a: a["history"] >= 1, PATIENCE, "the avatar of the checkpoint")
        assert studio.document()["avatar"]["source"].endswith("casual-tiny")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else None)
