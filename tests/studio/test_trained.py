"""A trained avatar in the window: opened by drop; then a wrist, a light, the elbow radius and the camera are moved by
hand, and after each exactly the buffers differ that should. ARS_TRAINED_AVATAR names an avatar, a run or a checkpoint;
else a few steps of preset `tiny` make one of the test data's capture. Draft and full times are printed, not judged.
"""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

from driver import Studio
from exr_layers import Layers

SHADED = {"beauty", "diffuse", "specular"}
EVERYTHING = SHADED | {"radiance", "albedo", "roughness", "normal", "depth", "position", "ao", "radius", "importance",
                       "bone", "opacity"}
PATIENCE = 900  # seconds; never waited for, unless something hangs
TINY = ["schedule.radiance_steps=6", "schedule.pbr_steps=6"]


def trained_avatar(folder):
    """An avatar to open; None where nothing can be had."""
    if given := os.environ.get("ARS_TRAINED_AVATAR"):
        return pathlib.Path(given).resolve()
    capture = pathlib.Path(os.environ.get("ARS_TEST_DATA") or "", "capture", "casual")
    if not os.environ.get("ARS_TEST_DATA") or not capture.exists():
        return None
    run = folder / "casual-tiny"
    settings = [word for setting in TINY for word in ("--set", setting)]
    subprocess.run([os.environ["ARS_PROGRAM"], "train", "--capture", str(capture), "--run", str(run), "--preset", "tiny",
                    *settings], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return run


class Watch:
    """Frames that the window shows while a hand does something."""

    def __init__(self, studio):
        self.studio, self.drafts = studio, {}

    def look(self):
        frame = self.studio.ask()["frame"]
        if frame["quality"] == "draft":
            self.drafts[frame["request"]] = frame
        return frame

    def drag(self, begin, end, steps=10):
        studio = self.studio
        studio.move(*begin)
        time.sleep(0.4)
        studio.xdotool("mousedown", 1)
        time.sleep(0.2)
        for i in range(1, steps + 1):
            studio.move(begin[0] + (end[0] - begin[0]) * i / steps, begin[1] + (end[1] - begin[1]) * i / steps)
            time.sleep(0.1)
            self.look()
        studio.xdotool("mouseup", 1)

    def until_full(self, act):
        begin = time.time()
        while True:
            answer = self.studio.ask()
            self.look()
            if answer["settled"] and answer["frame"]["quality"] == "full":
                break
            assert time.time() - begin < PATIENCE, f"no full picture after {act}"
            time.sleep(0.01)
        frame = answer["frame"]
        times = sorted(f["ms"] for f in self.drafts.values())
        drafts = "no draft seen"
        if times:
            last = list(self.drafts.values())[-1]
            drafts = (f"{len(times)} drafts seen, best {times[0]:.0f} ms, half below {times[len(times) // 2]:.0f} ms, "
                      f"worst {times[-1]:.0f} ms, the last of {last['width']}x{last['height']}")
        print(f"{act}: {drafts}; full {frame['width']}x{frame['height']} {1e3 * (time.time() - begin):.0f} ms after the hand",
              flush=True)


class Buffers:
    """The buffers of every state, exported by the screenshot's dialog."""

    def __init__(self, studio):
        self.studio, self.count = studio, 0
        self.last = self.former = self.export()
        missing = EVERYTHING - set(self.last.lines)
        assert not missing, f"the export lacks {missing}"

    def export(self):
        file = self.studio.folder / f"buffers-{self.count}.exr"
        self.count += 1
        self.studio.key("F12")
        self.studio.type_path(file)
        self.studio.wait(lambda a: file.exists() and a["settled"], PATIENCE, "the exported buffers")
        return Layers(file)

    def expect(self, act, expected):
        """Exactly these differ from the state before; returns the pixels of each."""
        now = self.export()
        changed = {layer: self.last.difference(now, layer) for layer in sorted(EVERYTHING)}
        covered = max(now.covered(), 1)
        print(f"{act} changes " + ", ".join(f"{layer} {100 * len(pixels) / covered:.1f} %"
                                            for layer, pixels in changed.items() if pixels), flush=True)
        wrong = {layer for layer, pixels in changed.items() if bool(pixels) != (layer in expected)}
        assert not wrong, f"{act}: {', '.join(sorted(wrong))} changed or stood against what it should"
        self.former, self.last = self.last, now
        return changed


def main(pictures):
    folder = pathlib.Path(tempfile.mkdtemp(prefix="ars-trained-"))
    avatar = trained_avatar(folder)
    if avatar is None:
        print("NOT RUN: no trained avatar; set ARS_TRAINED_AVATAR, or ARS_TEST_DATA to have one made")
        return
    light = folder / "rim.exr"
    subprocess.run([os.environ["ARS_PROGRAM"], "light", "studio:rim", "--out", str(light)], check=True,
                   stdout=subprocess.DEVNULL)

    with Studio(size="1280x1180", folder=folder / "studio") as studio:
        def keep(name):
            if pictures:
                studio.move(*(c + 4 for c in studio.viewport()[:2]))
                time.sleep(0.5)
                studio.screenshot(pictures / f"studio-trained-{name}.png")

        x, y, w, h = studio.viewport()
        studio.drop(x + w / 2, y + h / 2, avatar)
        studio.wait(lambda a: a["history"] >= 1, PATIENCE, "the dropped avatar")
        studio.settle(PATIENCE)
        assert studio.document()["avatar"]["source"] == str(avatar)
        begin = studio.document()
        buffers = Buffers(studio)
        keep("opened")

        # A wrist: the document's pose alone; the networks see all of it, so that every buffer may answer.
        # Taken a little up the arm: beside the joint lies the thumb.
        at, elbow, watch = studio.joint("left_wrist"), studio.joint("left_elbow"), Watch(studio)
        hold = [w + 0.12 * (e - w) for w, e in zip(at, elbow)]
        watch.drag(hold, (hold[0] + 56, hold[1] - 144))
        watch.until_full("wrist")
        document = studio.document()
        assert document["pose"] != begin["pose"], "the pose did not change"
        hand = studio.joint("left_wrist")
        assert hand[1] < at[1] - 60, f"the wrist went from {at} to {hand}, expected it to follow the pointer upwards"
        for section in ("avatar", "light", "occlusion", "camera"):
            assert document[section] == begin[section], f"the wrist changed {section}"
        buffers.expect("wrist", EVERYTHING)
        keep("wrist")

        # Another light.
        watch = Watch(studio)
        studio.drop(x + w / 2, y + h / 2, light)
        studio.wait(lambda a: a["history"] >= 3, PATIENCE, "the dropped light")
        watch.until_full("light")
        assert studio.document()["light"]["file"].endswith("rim.exr")
        changed = buffers.expect("light", SHADED)
        assert len(changed["beauty"]) > 0.9 * buffers.last.covered(), "a light that reaches a part of the body only"
        keep("light")

        # The radius of the elbows, by its slider.
        studio.show("Occlusion")
        before, watch = studio.document()["occlusion"], Watch(studio)
        rect = studio.rect("//Occlusion/**/##Elbow radius")
        watch.drag((rect[0] + 0.3 * rect[2], rect[1] + rect[3] / 2), (rect[0] + 0.92 * rect[2], rect[1] + rect[3] / 2))
        watch.until_full("elbow radius")
        after = studio.document()["occlusion"]
        assert {part for part in after["radii"] if after["radii"][part] != before["radii"][part]} == {"elbow"}
        assert after["radii"]["elbow"] > 1.2 * before["radii"]["elbow"], after["radii"]
        changed = buffers.expect("elbow radius", SHADED | {"ao", "radius"})
        for layer in SHADED | {"ao"}:
            # Files hold half floats: at the rim of what belongs to an elbow the radius changes by less than their step, and
            # single pixels of others by the last bit of what they round.
            far = {(c, r) for c, r in changed[layer]
                   if not any((c + i, r + j) in changed["radius"] for i in range(-4, 5) for j in range(-4, 5))}
            steps = {pixel: buffers.former.steps(buffers.last, layer, pixel) for pixel in far}
            print(f"{layer} changed in {len(far)} pixels away from where the radius did, by {max(steps.values(), default=0)} "
                  f"steps of a half float at most", flush=True)
            wrong = {pixel: step for pixel, step in steps.items() if step > 1}
            assert not wrong, f"{layer} changed by more than a rounding where the radius did not: {wrong}"
        vx, vy, vw, vh = studio.viewport()
        for side in ("left", "right"):
            ex, ey = studio.joint(f"{side}_elbow")
            column, row = (ex - vx) / vw * buffers.last.width, (ey - vy) / vh * buffers.last.height
            reach = 0.08 * buffers.last.height
            near = [p for p in changed["radius"] if abs(p[0] - column) < reach and abs(p[1] - row) < reach]
            assert len(near) > 20, f"nothing changed around the {side} elbow"
        for part in ("head", "left_knee", "right_knee", "left_ankle"):
            px, py = studio.joint(part)
            column, row = (px - vx) / vw * buffers.last.width, (py - vy) / vh * buffers.last.height
            near = [p for p in changed["radius"] if abs(p[0] - column) < 12 and abs(p[1] - row) < 12]
            assert not near, f"the elbow's radius changed the {part}"
        keep("elbow")

        # The camera, by a drag beside the body.
        pose, watch = studio.document()["pose"], Watch(studio)
        watch.drag((vx + 0.08 * vw, vy + vh / 2), (vx + 0.08 * vw + 160, vy + vh / 2))
        watch.until_full("camera")
        document = studio.document()
        assert document["camera"] != begin["camera"] and document["pose"] == pose
        buffers.expect("camera", EVERYTHING)
        keep("camera")

        while studio.ask()["undo"]:
            studio.key("ctrl+z")
        studio.settle(PATIENCE)
        assert not studio.document()["avatar"]["source"].endswith(avatar.name), "undo left the avatar open"
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else None)
