"""Drives the window as a person does: a real X server, pointer and keyboard (xdotool), screenshots (ImageMagick).

Where things are is asked of the program (ui/script_probe.h), which only looks; everything that changes anything goes
through the pointer, the keyboard or a drag from another program.
"""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

PATIENCE = 300  # seconds for what takes a moment: nobody waits for them, unless something hangs
HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent


class Picture:
    """Pixels of a screenshot or a file, RGB bytes."""

    def __init__(self, path, geometry=None):
        crop = ["-crop", geometry, "+repage"] if geometry else []
        ppm = subprocess.run(["convert", str(path), *crop, "-alpha", "off", "-depth", "8", "ppm:-"], check=True,
                             capture_output=True).stdout
        fields, position = [], 0
        while len(fields) < 4:
            end = position
            while ppm[end:end + 1] not in (b" ", b"\n"):
                end += 1
            fields.append(ppm[position:end])
            position = end + 1
        self.width, self.height = int(fields[1]), int(fields[2])
        self.bytes = ppm[position:]

    def at(self, x, y):
        i = 3 * (int(y) * self.width + int(x))
        return tuple(self.bytes[i:i + 3])

    def difference(self, other):
        """Share of the pixels that differ by more than 8 of 255 in some channel."""
        assert (self.width, self.height) == (other.width, other.height), "pictures of different sizes"
        a, b = self.bytes, other.bytes
        changed = sum(1 for i in range(0, len(a), 3)
                      if abs(a[i] - b[i]) > 8 or abs(a[i + 1] - b[i + 1]) > 8 or abs(a[i + 2] - b[i + 2]) > 8)
        return changed / (self.width * self.height)

    def colors(self):
        return len({self.bytes[i:i + 3] for i in range(0, len(self.bytes), 3)})


class Studio:
    """A running program. `with Studio() as studio:` ends it, and fails when it ended badly by itself."""

    def __init__(self, *arguments, size="1280x800", folder=None, keep=False, environment=None):
        self.folder = pathlib.Path(folder or tempfile.mkdtemp(prefix="ars-studio-"))
        self.temporary = folder is None and not keep
        self.probe = self.folder / "probe"
        self.probe.mkdir(parents=True, exist_ok=True)
        self.state = self.folder / "state"
        self.timings = self.folder / "timings.json"
        self.number = int(time.time() * 1000)
        self.log = open(self.folder / "log.txt", "ab")
        self.size = size
        command = [os.environ["ARS_PROGRAM"], "studio", *map(str, arguments), "--size", size, "--state-folder",
                   str(self.state), "--script-probe", str(self.probe), "--timings", str(self.timings)]
        env = dict(os.environ, ARS_FILE_CHOOSER="internal", ARS_STATE=str(self.state), **(environment or {}))
        self.begin = time.time()
        self.process = subprocess.Popen(command, stdout=self.log, stderr=subprocess.STDOUT, env=env)

    def __enter__(self):
        try:
            self.wait(lambda a: a["frame"] is not None, 240, "the first picture")
            self.first_picture_s = time.time() - self.begin
            self.settle(600)
        except BaseException:
            self.process.kill()
            self.complain()
            raise
        return self

    def __exit__(self, kind, value, trace):
        if kind is not None:
            if self.process.poll() is None:
                self.screenshot(self.folder / "failure.png")
                self.process.kill()
            self.complain()
            return
        self.quit()
        if self.temporary:
            shutil.rmtree(self.folder, ignore_errors=True)

    def complain(self):
        sys.stderr.write(f"kept: {self.folder}\n")
        sys.stderr.write((self.folder / "log.txt").read_text(errors="replace")[-3000:])

    def quit(self):
        """Ctrl+Q; what is unsaved is given up."""
        if self.process.poll() is None:
            self.key("ctrl+q")
            for _ in range(600):
                if self.process.poll() is not None:
                    break
                time.sleep(0.1)
                answer = self.try_ask(["//###Unsaved/Discard"], timeout=1.0)
                if answer and answer["items"]["//###Unsaved/Discard"]:
                    self.click_at(*self.middle(answer["items"]["//###Unsaved/Discard"]))
        code = self.process.wait(timeout=120)
        assert code == 0, f"the program ended with {code}"
        self.print_timings(json.loads(self.timings.read_text()))

    def print_timings(self, timings):
        """How long the window's frames took; said, not judged: the machine may be busy with other things."""
        start, longest, share = timings["start_up"], timings["longest"], timings["percentiles_ms"]
        stalls = sum(b["count"] for b in timings["histogram"] if b.get("below_ms", 1000) > 100)
        print(f"first picture after {self.first_picture_s:.2f} s; start-up: {start['frames']} frames, longest "
              f"{start['longest_ms']:.0f} ms; then {timings['frames']} frames: half below {share['50']:.1f} ms, 99 % below "
              f"{share['99']:.1f} ms, longest {longest['total_ms']:.0f} ms ({longest['processor_ms']:.0f} ms of processor: "
              f"widgets {longest['widgets_ms']:.0f} ms, drawing {longest['draw_ms']:.0f} ms)", flush=True)

    # --- looking
    def try_ask(self, items=(), document=False, timeout=120.0):
        self.number += 1
        question = {"number": self.number, "items": list(items), "document": document}
        temporary = self.probe / "ask.tmp"
        temporary.write_text(json.dumps(question))
        temporary.rename(self.probe / "ask.json")
        end = time.time() + timeout
        while time.time() < end:
            if self.process.poll() is not None:
                return None
            try:
                answer = json.loads((self.probe / "answer.json").read_text())
                if answer["number"] == self.number:
                    return answer
            except (OSError, ValueError):
                pass
            time.sleep(0.01)
        return None

    def ask(self, items=(), document=False):
        answer = self.try_ask(items, document)
        assert answer is not None, "the program does not answer"
        return answer

    def document(self):
        return self.ask(document=True)["document"]

    def wait(self, condition, seconds, what):
        end = time.time() + seconds
        while time.time() < end:
            answer = self.try_ask(timeout=end - time.time())
            assert self.process.poll() is None, f"the program ended while waiting for {what}"
            if answer and condition(answer):
                return answer
            time.sleep(0.02)
        raise AssertionError(f"waited {seconds} s for {what}")

    def taken_in(self):
        """Waits until the window has taken in all that was typed and pointed at, and has drawn what came of it.

        The first answer may be older than the input. From the second on it has come, though it may wait in the queue:
        a click or key is seen when the one before it has been drawn. A key that is held goes on giving more."""
        answers, given, calm, end = 0, None, 0, time.time() + PATIENCE
        while calm < 2:
            answer = self.try_ask(timeout=end - time.time())
            if self.process.poll() is not None:
                return
            assert answer is not None, "the program does not answer"
            assert time.time() < end, "the program does not take in what was typed"
            answers += 1
            if answers == 2:
                given = answer["input"]["given"]
            calm = calm + 1 if given is not None and answer["input"]["taken"] >= given else 0

    def settle(self, seconds=PATIENCE):
        self.taken_in()
        return self.wait(lambda a: a["settled"], seconds, "everything to stand still")

    @staticmethod
    def middle(rect):
        return rect[0] + rect[2] / 2, rect[1] + rect[3] / 2

    def rect(self, item):
        """Rectangle of a widget; an unfolded, visible one."""
        for _ in range(50):
            found = self.ask([item])["items"][item]
            if found:
                return found
            time.sleep(0.1)
        self.screenshot(self.folder / "missing.png")
        raise AssertionError(f"no widget {item} on the screen; kept {self.folder / 'missing.png'}")

    def screenshot(self, path):
        """The window, which stands in the corner of a screen that may be larger."""
        subprocess.run(["import", "-window", "root", "-crop", f"{self.size}+0+0", "+repage", str(path)], check=True)
        return path

    def picture(self):
        """The viewport's picture as it is on the screen."""
        path = self.folder / "now.png"
        x, y, w, h = map(int, self.viewport())
        self.move(x + w / 2, y + h + 150)  # nothing is to light up under the pointer
        self.taken_in()
        time.sleep(0.2)
        self.screenshot(path)
        return Picture(path, f"{w}x{h}+{x}+{y}")

    def viewport(self):
        return self.rect("//Viewport/Picture")

    def joint(self, name):
        """Where a joint is on the screen."""
        x, y, w, h = self.viewport()
        u, v = self.ask()["joints"][name]
        return x + u * w, y + v * h

    # --- doing
    def xdotool(self, *arguments):
        subprocess.run(["xdotool", *map(str, arguments)], check=True)

    def move(self, x, y):
        self.xdotool("mousemove", round(x), round(y))

    def click_at(self, x, y, button=1):
        self.move(x, y)
        time.sleep(0.08)
        self.xdotool("mousedown", button)
        time.sleep(0.08)
        self.xdotool("mouseup", button)
        self.taken_in()

    def click(self, item, button=1):
        self.click_at(*self.middle(self.rect(item)), button=button)

    def double_click(self, item):
        self.move(*self.middle(self.rect(item)))
        time.sleep(0.05)
        self.xdotool("click", "--repeat", 2, "--delay", 60, 1)
        self.taken_in()

    def drag(self, begin, end, button=1, steps=24, seconds=1.0, hold=None, release=True):
        if hold:
            self.xdotool("keydown", hold)
            self.taken_in()
        self.move(*begin)
        self.taken_in()
        self.xdotool("mousedown", button)
        self.taken_in()
        for i in range(1, steps + 1):
            t = i / steps
            self.move(begin[0] + (end[0] - begin[0]) * t, begin[1] + (end[1] - begin[1]) * t)
            time.sleep(seconds / steps)
        self.taken_in()
        if release:
            self.release(button)
        if hold:
            self.xdotool("keyup", hold)
            self.taken_in()

    def release(self, button=1):
        self.xdotool("mouseup", button)
        self.taken_in()

    def key(self, *chords):
        """Presses chords one after the other, "ctrl+shift+z", each held as long as fingers hold them."""
        for chord in chords:
            *modifiers, key = chord.split("+")
            for modifier in modifiers:
                self.xdotool("keydown", modifier)
                time.sleep(0.05)
            self.xdotool("keydown", key)
            time.sleep(0.08)
            self.xdotool("keyup", key)
            for modifier in reversed(modifiers):
                time.sleep(0.05)
                self.xdotool("keyup", modifier)
            self.taken_in()

    def type(self, text):
        self.xdotool("type", "--delay", 15, text)
        self.taken_in()

    def type_into(self, item, text):
        """Ctrl+click turns a slider into a number box."""
        self.move(*self.middle(self.rect(item)))
        self.taken_in()
        self.xdotool("keydown", "ctrl", "click", 1, "keyup", "ctrl")
        self.taken_in()
        self.key("ctrl+a")
        self.type(text)
        self.key("Return")

    def show(self, panel):
        """Brings a panel to the front by its tab."""
        if panel not in self.ask()["windows"]:
            self.palette("Show " + panel)
        self.wait(lambda a: panel in a["windows"], PATIENCE, f"the panel {panel}")

    def palette(self, text):
        """Finds a command by its words and runs it."""
        self.key("ctrl+k")
        self.type(text)
        self.key("Return")

    def type_path(self, path):
        """Answers the file chooser by typing."""
        item = "//###FileChooser/###Name"
        self.click(item)
        self.key("ctrl+a")
        self.type(str(path))
        self.key("Return")

    def discard_changes(self):
        """Answers the question about unsaved changes, where it comes."""
        for _ in range(15):
            answer = self.ask(["//###Unsaved/Discard"])
            if answer["items"]["//###Unsaved/Discard"]:
                return self.click("//###Unsaved/Discard")
            time.sleep(0.1)

    def drop(self, x, y, *files):
        subprocess.run([sys.executable, str(HERE / "drag_source.py"), str(round(x)), str(round(y)), *map(str, files)],
                       check=True)
