"""Swaps the light by dropping a file and by the dialog, turns it by hand, and takes a screenshot that remembers it."""
import pathlib
import subprocess
import sys
import os

from driver import PATIENCE, Picture, Studio


def main(pictures):
    with Studio() as studio:
        folder = studio.folder
        for name, words in (("evening", "sky:4,80"), ("rim", "studio:rim")):
            subprocess.run([os.environ["ARS_PROGRAM"], "light", words, "--out", str(folder / f"{name}.exr")], check=True,
                           stdout=subprocess.DEVNULL)
        first = studio.picture()

        # By drop, as from a file manager.
        x, y, w, h = studio.viewport()
        studio.drop(x + w / 2, y + h / 2, folder / "evening.exr")
        studio.wait(lambda a: a["history"] == 1, PATIENCE, "the dropped light")
        studio.settle()
        document = studio.document()
        assert document["light"]["file"].endswith("evening.exr") and document["light"]["kind"] == "file"
        evening = studio.picture()
        assert first.difference(evening) > 0.03, "another light, the same picture"

        # By dialog.
        studio.key("ctrl+o")
        studio.type_path(folder / "rim.exr")
        studio.wait(lambda a: a["history"] == 2 and a["settled"], PATIENCE, "the light of the dialog")
        assert studio.document()["light"]["file"].endswith("rim.exr")
        rim = studio.picture()
        assert evening.difference(rim) > 0.03

        # Turned by dragging in the picture with L held.
        before, camera = studio.document()["light"]["rotation"], studio.document()["camera"]
        studio.drag((x + 60, y + h / 2), (x + 200, y + h / 2), hold="l")
        studio.settle()
        document = studio.document()
        assert document["light"]["rotation"] != before, "the light did not turn"
        assert document["camera"] == camera, "the camera moved, too"
        turned = studio.picture()
        assert rim.difference(turned) > 0.01
        studio.show("Light")
        studio.settle()
        if pictures:
            studio.screenshot(pictures / "studio-light.png")

        # A broken file: a dialog with a sentence, and nothing is lost.
        broken = folder / "broken.exr"
        broken.write_bytes((folder / "rim.exr").read_bytes()[:300])
        studio.drop(x + w / 2, y + h / 2, broken)
        studio.wait(lambda a: any("###Error" in name for name in a["windows"]), PATIENCE, "the error")
        assert studio.document() == document, "a broken file changed the document"
        studio.key("Return")

        # What the screenshot holds restores the session.
        studio.key("F12")
        shot = folder / "shot.png"
        studio.type_path(shot)
        studio.wait(lambda a: shot.exists() and a["settled"], PATIENCE, "the screenshot")
        assert Picture(shot).width > 300
        studio.key("ctrl+z", "ctrl+z", "ctrl+z")
        studio.settle()
        assert studio.document()["light"]["kind"] != "file"
        studio.drop(x + w / 2, y + h / 2, shot)
        studio.discard_changes()
        studio.wait(lambda a: a["settled"] and a["history"] == 0, PATIENCE, "the restored session")
        assert studio.document()["light"] == document["light"]


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else None)
