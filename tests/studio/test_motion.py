"""Keys a pose and another, plays between them, exports a film, and finds the edits again after a kill -9."""
import json
import pathlib
import subprocess
import sys
import time

from driver import PATIENCE, Studio


SECTIONS = ("pose", "timeline", "camera", "light", "occlusion")


def autosaved(folder, document):
    saves = [json.loads(file.read_text()) for file in folder.rglob("autosave-*.ars")]
    return any(all(save[section] == document[section] for section in SECTIONS) for save in saves)


def main(pictures):
    studio = Studio(keep=True)
    studio.__enter__()
    try:
        # A key at the beginning, another pose with a key at 2 s.
        studio.key("i")
        studio.type_into("//Timeline/###Time", "2")
        elbow, wrist = studio.joint("right_elbow"), studio.joint("right_wrist")
        x, y = (elbow[0] + wrist[0]) / 2, (elbow[1] + wrist[1]) / 2  # by the forearm
        studio.drag((x, y), (x - 60, y - 130))
        studio.settle()
        studio.key("i")
        document = studio.document()
        tracks = document["timeline"]["joints"]
        assert tracks and max(len(t["keys"]) for t in tracks) >= 2, "no two keys"
        raised = studio.picture()

        # Playing moves the arm by itself.
        studio.type_into("//Timeline/###Time", "0")
        studio.settle()
        rest = studio.picture()
        assert rest.difference(raised) > 0.01
        studio.move(*studio.middle(studio.viewport()))
        studio.key("space")
        seen, end = set(), time.time() + PATIENCE
        while len(seen) <= 3:
            assert time.time() < end, f"the arm stood still: {seen}"
            seen.add(round(studio.joint("right_wrist")[1]))
            time.sleep(0.15)
        studio.key("space")
        studio.settle()
        assert studio.document()["timeline"]["time"] > 0.0, "pausing forgot the time"
        if pictures:
            studio.screenshot(pictures / "studio-motion.png")

        # A film of the range.
        film = studio.folder / "film.mp4"
        studio.key("ctrl+F12")
        studio.type_path(film)
        studio.wait(lambda a: film.exists() and a["settled"], PATIENCE, "the film")
        info = subprocess.run(["ffprobe", "-v", "error", "-count_packets", "-select_streams", "v", "-show_entries",
                               "stream=nb_read_packets,width", "-of", "json", str(film)], check=True, capture_output=True)
        stream = json.loads(info.stdout)["streams"][0]
        timeline = studio.document()["timeline"]
        expected = round((timeline["end"] - timeline["start"]) * timeline["rate"])
        assert abs(int(stream["nb_read_packets"]) - expected) <= 1, stream

        # The program is killed; the next one finds the edits.
        edited = studio.document()
        studio.wait(lambda a: studio.timings.exists() and autosaved(studio.state, edited), PATIENCE, "the autosave")
        studio.process.kill()
        studio.process.wait()
        studio.print_timings(json.loads(studio.timings.read_text()))  # as of some seconds before
    except BaseException:
        studio.__exit__(*sys.exc_info())
        raise
    with Studio(folder=studio.folder) as again:
        again.click("//###Recovery/Restore")
        again.wait(lambda a: a["settled"], PATIENCE, "the recovered session")
        document = again.document()
        for section in SECTIONS:
            assert document[section] == edited[section], f"{section} was lost"


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else None)
