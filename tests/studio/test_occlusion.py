"""Changes the occlusion radius of a part by its slider and locks it; AO and radius follow, albedo does not."""
import pathlib
import sys

from driver import Studio


def look(studio, label):
    studio.click(f"//Buffers/**/###{label}")
    studio.settle()
    return studio.picture()


def main(pictures):
    with Studio() as studio:
        before = {label: look(studio, label) for label in ("Ambient occlusion", "Occlusion radius", "Albedo")}
        studio.show("Occlusion")
        begin = studio.document()["occlusion"]
        x, y, w, h = studio.rect("//Occlusion/**/##Torso radius")
        # By hand: from where the grab is to the far end.
        studio.drag((x + 0.29 * w, y + h / 2), (x + 0.95 * w, y + h / 2))
        studio.settle()
        changed = studio.document()["occlusion"]
        assert changed != begin, "the radius did not change"
        assert {k for k in changed if changed[k] != begin[k]} == {"radii"}, "more than the radii changed"
        assert changed["radii"]["torso"] > 1.5 * begin["radii"]["torso"], changed["radii"]
        assert len([p for p in changed["radii"] if changed["radii"][p] != begin["radii"][p]]) == 1
        assert studio.ask()["history"] >= 1

        if pictures:
            look(studio, "Ambient occlusion")
            studio.screenshot(pictures / "studio-occlusion.png")
        for label, bound, up in (("Ambient occlusion", 0.001, True), ("Occlusion radius", 0.01, True), ("Albedo", 1e-4, False)):
            difference = before[label].difference(look(studio, label))
            assert (difference > bound) == up, f"{label} changed in {difference:.5f} of the pixels"

        while studio.ask()["undo"]:
            studio.key("ctrl+z")
        assert studio.document()["occlusion"] == begin


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else None)
