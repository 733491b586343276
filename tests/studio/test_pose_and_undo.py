"""Opens the program, drags a hand, looks at six buffers, undoes everything, saves and opens the project again."""
import json
import os
import pathlib
import sys
import time

from driver import PATIENCE, Studio


def main(pictures):
    with Studio() as studio:
        begin = studio.document()
        before = studio.picture()

        # A hand follows the pointer: a draft while it moves, the full picture when it rests.
        x, y = studio.joint("left_wrist")
        studio.drag((x + 4, y + 14), (x + 60, y - 130), release=False)
        seen = studio.ask()["frame"]["quality"]
        studio.release()
        studio.settle()
        assert seen in ("draft", "refining", "full"), seen
        after = studio.picture()
        document = studio.document()
        assert document["pose"] != begin["pose"], "the pose did not change"
        assert len([k for k in document if document[k] != begin[k]]) <= 2, "more than pose and view changed"
        assert before.difference(after) > 0.02, "the picture did not change"
        hand = studio.joint("left_wrist")
        assert abs(hand[0] - (x + 56)) < 25 and abs(hand[1] - (y - 144)) < 25, f"the hand is at {hand}"
        if pictures:
            studio.screenshot(pictures / "studio-pose.png")

        # Six buffers, each another picture.
        seen = [after]
        for label in ("Albedo", "Normal", "Depth", "Ambient occlusion", "Occlusion radius", "Sample importance"):
            studio.click(f"//Buffers/**/###{label}")
            studio.settle()
            shown = studio.picture()
            assert shown.colors() > 20, f"{label} shows nothing"
            assert all(shown.difference(other) > 0.01 for other in seen), f"{label} looks like another buffer"
            seen.append(shown)
        studio.click("//Buffers/**/###Shaded")
        studio.settle()

        # Save, then undo all, then open what was saved.
        project = studio.folder / "one.ars"
        edited = studio.document()
        studio.key("ctrl+s")
        studio.type_path(project)
        studio.wait(lambda a: project.exists(), PATIENCE, "the project file")
        while studio.ask()["undo"]:
            studio.key("ctrl+z")
        assert studio.document() == begin, "undo did not return to the beginning"
        studio.key("ctrl+shift+z")
        assert studio.document() != begin, "redo did nothing"
        studio.key("ctrl+z")
        studio.key("ctrl+o")
        studio.type_path(project)
        studio.discard_changes()
        studio.wait(lambda a: a["history"] == 0 and a["settled"], PATIENCE, "the project")
        assert studio.document()["pose"] == edited["pose"], "the project came back changed"
        assert studio.picture().difference(after) < 0.002, "the saved project looks different"
        assert json.loads(project.read_text())["pose"] == edited["pose"]


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else None)
