"""`ars train` and `ars eval` as they are called: exit codes, requests, Ctrl-C, JSON, wrong usage, broken captures."""
import json
import os
import pathlib
import shutil
import signal
import struct
import sys
import zlib

import runs

CAMERAS = ("24110001", "24110004", "24110009")
FRAMES = range(4)
LONG = runs.SMALL + ("schedule.radiance_steps=4000",)


def small_capture(source, folder):
    """Three cameras and four frames of the shared capture, as links; the calibration is a file of its own."""
    calibration = json.loads((source / "calibration_full.json").read_text())
    for camera in CAMERAS:
        (folder / camera / "mask" / "pha").mkdir(parents=True)
        for frame in FRAMES:
            for name in (f"{frame:08d}.jpg", f"mask/pha/{frame:08d}.jpg"):
                found = sorted((source / camera / name).parent.glob(f"{frame:08d}.*"))
                (folder / camera / name).with_name(found[0].name).symlink_to(found[0].resolve())
    for name in ("smpl_params.npz", "template.glb"):
        (folder / name).symlink_to((source / name).resolve())
    (folder / "calibration_full.json").write_text(json.dumps({camera: calibration[camera] for camera in CAMERAS}))
    return folder


def grey_png(width, height):
    def chunk(kind, blob):
        return struct.pack(">I", len(blob)) + kind + blob + struct.pack(">I", zlib.crc32(kind + blob))
    lines = (b"\0" + b"\xff" * width) * height
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b""))


def change_camera(capture, change):
    path = capture / "calibration_full.json"
    calibration = json.loads(path.read_text())
    change(calibration[CAMERAS[1]])
    path.write_text(json.dumps(calibration))


def mask_of_another_size(capture):
    """A PNG under a JPEG's name: readers go by the content."""
    mask = next((capture / CAMERAS[2] / "mask" / "pha").glob("00000001.*"))
    mask.unlink()
    mask.write_bytes(grey_png(20, 28))


def frame_after_the_motion(capture):
    for folder in (capture / CAMERAS[0], capture / CAMERAS[0] / "mask" / "pha"):
        picture = next(folder.glob("00000000.*"))
        (folder / ("00009999" + picture.suffix)).symlink_to(picture.resolve())


def without_pictures(capture):
    shutil.rmtree(capture / CAMERAS[1])
    (capture / CAMERAS[1]).mkdir()


BROKEN = {
    "no calibration": (lambda c: (c / "calibration_full.json").unlink(), ("no calibration", "calibration_full.json")),
    "a wrong key": (lambda c: change_camera(c, lambda k: k.update(Kmat=k.pop("K"))), (CAMERAS[1], "K is missing")),
    "a camera without pictures": (without_pictures, (CAMERAS[1], "no picture")),
    "a mask of another size": (mask_of_another_size, (CAMERAS[2], "00000001", "20 x 28")),
    "a frame without a pose": (frame_after_the_motion, ("smpl_params.npz", "9999")),
    "no camera": (lambda c: (c / "calibration_full.json").write_text("{}"), ("calibration_full.json", "no camera")),
    "an absurd focal length": (lambda c: change_camera(c, lambda k: k.update(K=[1e9, 0, 100, 0, 1e9, 100, 0, 0, 1])),
                               (CAMERAS[1], "focal length")),
    "an absurd principal point": (lambda c: change_camera(c, lambda k: k.update(K=[500, 0, 1e6, 0, 500, 100, 0, 0, 1])),
                                  (CAMERAS[1], "principal point")),
}


def broken_captures(source, folder):
    """One sentence, before anything is made."""
    for name, (spoil, words) in BROKEN.items():
        capture, run = small_capture(source, folder / "broken"), folder / "never"
        spoil(capture)
        for arguments in (runs.train_arguments(run, capture, runs.SMALL),
                          ["eval", "--avatar", f"rest:{source / 'template.glb'}", "--capture", capture, "--out", run]):
            code, output, errors = runs.ars(*arguments, "--quiet")
            sentence = runs.failed(code, errors, *words)
            assert errors.count("\n") == 1 and output == "", f"{name}: {output}{errors}"
            assert len(sentence) < 400 and not run.exists(), f"{name}: {sentence}"
        print(f"{name}: {sentence}", flush=True)
        shutil.rmtree(capture)


def wrong_usage(code, text, *words):
    assert code == 2, f"expected exit code 2, found {code}: {text}"
    for word in words:
        assert word in text, f'no "{word}" in: {text}'


def usage(capture, folder):
    run = folder / "unused"
    new = runs.train_arguments(run, capture)
    for words, arguments in (
            (("schedule.radiance_stepss", "schedule.radiance_steps"), [*new, "--set", "schedule.radiance_stepss=3"]),
            (("loss.l2", "loss.l1"), [*new, "--set", "loss.l2=3"]),
            (("loss.l1", "1e+06"), [*new, "--set", "loss.l1=1e39"]),
            (("NAME=VALUE",), [*new, "--set", "loss.l1"]),
            (("--preset", "tiny"), ["train", "--run", run, "--capture", capture, "--preset", "huge"]),
            (("--run",), ["train", "--capture", capture]),
            (("--capture",), ["train", "--run", run]),
            (("--request",), ["train", "--run", run, "--request", "sleep"])):
        code, _, errors = runs.ars(*arguments)
        wrong_usage(code, errors, *words)
        assert not run.exists()
    # In lines of JSON too.
    code, output, errors = runs.ars(*new, "--set", "loss.l2=3", "--json")
    assert code == 2 and errors == "" and json.loads(output)["error"]["place"] == "--set", (code, output, errors)

    (folder / "plain").mkdir()
    (folder / "plain" / "notes.txt").write_text("mine")
    for arguments, words in (
            (["train", "--run", folder / "plain", "--resume"], ("no run folder",)),
            (["train", "--run", folder / "none", "--resume"], ("no run folder",)),
            (["train", "--run", folder / "none", "--status"], ("no run folder",)),
            (["train", "--run", folder / "none", "--request", "stop"], ("no run folder",)),
            (runs.train_arguments(folder / "plain", capture, runs.SMALL), ("notes.txt",)),
            (runs.train_arguments(folder / "none", folder / "nowhere", runs.SMALL), ("nowhere",)),
            (runs.train_arguments(folder / "none", os.fsdecode(b"capt\xffure"), runs.SMALL), ("UTF-8",)),
            (["eval", "--avatar", folder / "plain", "--capture", capture, "--out", folder / "o"],
             ("avatar.json",)),
            (["eval", "--avatar", folder / "none", "--capture", capture, "--out", folder / "o"], ("--avatar", "none")),
            (["eval", "--avatar", folder / "plain", "--capture", folder / "none", "--out", folder / "o"],
             ("--capture",))):
        code, _, errors = runs.ars(*arguments)
        runs.failed(code, errors, *words)
    assert (folder / "plain" / "notes.txt").read_text() == "mine" and not (folder / "none").exists()
    code, _, errors = runs.ars("eval", "--avatar", folder, "--capture", capture, "--out", folder / "o", "--protocol",
                               "mine")
    wrong_usage(code, errors, "--protocol", "masked")
    code, _, errors = runs.ars("eval", "--avatar", folder)
    wrong_usage(code, errors, "--capture")


def requests(capture, folder):
    """Pause, save, resume and stop from other processes, and two writers; lines of JSON all the while."""
    run = folder / "asked"
    process = runs.start(*runs.train_arguments(run, capture, LONG), "--json")
    runs.wait_for("steps", lambda: len(runs.rows(run)) >= 2, process)
    code, _, errors = runs.ars(*runs.train_arguments(run))
    runs.failed(code, errors, str(process.pid), "works on this run")
    code, _, errors = runs.ars(*runs.train_arguments(run, capture, LONG))
    wrong_usage(code, errors, "--resume")

    def ask(word, state):
        output = json.loads(runs.succeed("train", "--run", run, "--request", word, "--json"))
        assert output["request"] == word, output
        runs.wait_for(state, lambda: runs.status(run)["state"] == state, process)
    ask("pause", "paused")
    paused = len(runs.rows(run))
    assert runs.newest(run)[0] == paused, "a pause begins with a checkpoint"
    told = json.loads(runs.succeed("train", "--run", run, "--status", "--json"))
    assert told["state"] == "paused" and told["step"] == paused and told["process"] == process.pid, told
    assert "paused" in runs.succeed("train", "--run", run, "--status")
    ask("save", "paused")
    assert len(runs.rows(run)) == paused, "a paused run went on"
    ask("resume", "running")
    runs.wait_for("more steps", lambda: len(runs.rows(run)) > paused, process)
    runs.succeed("train", "--run", run, "--request", "stop")
    assert runs.ended(process) == 0, runs.words_of(process)
    step = len(runs.rows(run))
    assert runs.status(run)["state"] == "idle" and runs.newest(run)[0] == step
    lines = [json.loads(line) for line in runs.words_of(process).splitlines() if line.startswith("{")]
    assert [line["step"] for line in lines[:-1]] == list(range(1, step + 1)), "a line for each row of metrics"
    assert lines[-1]["status"]["state"] == "idle" and lines[-1]["status"]["step"] == step, lines[-1]
    code, _, errors = runs.ars("train", "--run", run, "--request", "pause")
    runs.failed(code, errors, "no process")
    return run


def interrupted(run, number):
    """Ctrl-C and SIGTERM: a checkpoint, a sentence that says how to go on, and the signal's exit code."""
    before = runs.newest(run)[0]
    process = runs.start(*runs.train_arguments(run))
    runs.wait_for("a step", lambda: runs.status(run).get("process") == process.pid and
                  runs.status(run)["step"] > before, process)
    process.send_signal(number)
    code = runs.ended(process)
    assert code == -number, f"expected to end by signal {number} (exit code {128 + number}), found {code}"
    step, text = len(runs.rows(run)), runs.words_of(process)
    assert step > before and runs.newest(run)[0] == step and runs.status(run)["state"] == "idle", text
    assert f"ars train --run {run} --resume" in text, f"nothing says how to go on: {text}"


def ends_by_itself(run):
    """Resumed to fewer steps it finishes; and once more, without a step."""
    step = runs.newest(run)[0]
    sets = (f"schedule.radiance_steps={step + 2}", "schedule.pbr_steps=1")
    output = runs.succeed(*runs.train_arguments(run, None, sets), "--json")
    lines = [json.loads(line) for line in output.splitlines()]
    assert [line["step"] for line in lines[:-1]] == [step + 1, step + 2, step + 3], output
    assert lines[-1]["status"]["state"] == "finished"
    assert (run / f"config.{step}.json").exists(), "the former settings are kept"
    assert "finished after" in runs.succeed(*runs.train_arguments(run))
    assert len(runs.rows(run)) == step + 3


def resumed_by_mistake(run):
    """What does not go with the run is refused, and costs it nothing: afterwards it resumes as if nobody had asked."""
    config, before = (run / "config.json").read_bytes(), runs.checkpoints(run)
    for setting, words in (("network.max_channels=4", "other networks"),
                           ("decoding.learn_base=false", "decoding.learn_base"),
                           ("light.cube_size=128", "light.cube_size"),
                           ("data.frames=5000", "5000")):
        code, _, errors = runs.ars(*runs.train_arguments(run, None, (setting,)))
        print(runs.failed(code, errors, words, f"the checkpoint of step {runs.newest(run)[0]} is intact"))
        assert (run / "config.json").read_bytes() == config, f"{setting} would be the next resume's too"
    for option in ("--preset", "--body", "--template"):
        code, _, errors = runs.ars(*runs.train_arguments(run), option, "tiny")
        wrong_usage(code, errors, option, "keeps its own")
    for damage in (lambda p: p.write_text('{"sta'), lambda p: p.unlink()):
        damage(run / "status.json")
        code, _, errors = runs.ars("train", "--run", run, "--status")
        runs.failed(code, errors, "status.json")
        assert "finished after" in runs.succeed(*runs.train_arguments(run))
    assert runs.checkpoints(run) == before and (run / "config.json").read_bytes() == config
    runs.expect_none_broken(run)


def from_other_folders(run, folder):
    """A relative path means the same wherever the run goes on."""
    (folder / "here").mkdir()
    runs.succeed(*runs.train_arguments(run, None, ("run.cache_folder=cache",)), cwd=folder / "here")
    runs.succeed(*runs.train_arguments(run), cwd=folder)
    cache = json.loads((run / "config.json").read_text())["training"]["run"]["cache_folder"]
    assert pathlib.Path(cache) == folder / "here" / "cache", cache


def evaluated(run, capture, folder):
    out = folder / "report"
    report = json.loads(runs.succeed("eval", "--avatar", run, "--capture", capture, "--out", out, "--frames", "0",
                                     "--cameras", CAMERAS[0], "--pictures", "1", "--json"))
    assert report == json.loads((out / "report.json").read_text())
    assert report["views"] == 1 and report["mean"]["radiance_psnr_mask"] > 5, report["mean"]
    assert report["lpips"] is None and list((out / "pictures").glob("*.png"))
    assert "radiance, PSNR in the mask" in (out / "report.txt").read_text()


def exported(run, capture, folder):
    """The run's avatar as a folder of its own: opens, is judged as the run is, and is shaded as it says itself."""
    avatar = folder / "anna.avatar"
    runs.succeed("export", "--avatar", run, "--out", f"{avatar}/", "--quiet")
    assert (avatar / "preview.png").exists() and not (avatar / "trainer.safetensors").exists()
    assert "trained avatar" in runs.succeed("info", avatar)
    means = [json.loads(runs.succeed("eval", "--avatar", which, "--capture", capture, "--out", folder / "of", "--frames",
                                     "0", "--cameras", CAMERAS[0], "--pictures", "0", "--json"))["mean"]
             for which in (run, avatar)]
    assert means[0] == means[1], means
    code, _, errors = runs.ars("export", "--avatar", run, "--out", folder / "anna")
    wrong_usage(code, errors, "--out", "NAME.avatar")
    code, _, errors = runs.ars("export", "--avatar", run, "--out", avatar, "--pose", "rest")
    wrong_usage(code, errors, "--pose")
    (avatar / "notes.txt").write_text("mine")
    code, _, errors = runs.ars("export", "--avatar", run, "--out", avatar)
    assert code != 0 and "notes.txt" in errors and (avatar / "notes.txt").exists(), errors
    (avatar / "notes.txt").unlink()

    def picture(name, *words):
        runs.succeed("render", "--avatar", avatar, "--size", "48x48", "--light-size", "64", "--device", "cpu", "--aov",
                     "ao", "--write", "buffers", "--quiet", "--out", folder / name, *words)
        return b"".join(path.read_bytes() for path in sorted((folder / name).rglob("*ao*.png")))
    shaded, off = picture("shaded"), picture("off", "--occlusion", "off")
    assert shaded and shaded != off, "it was trained with occlusion"
    description = json.loads((avatar / "avatar.json").read_text())
    assert description["occluded"] is True
    description["occluded"] = False
    (avatar / "avatar.json").write_text(json.dumps(description))
    assert picture("without") == off, "trained without occlusion it is shown without"
    assert picture("asked", "--occlusion", "body") == shaded, "what is asked for comes first"


def main():
    source = runs.capture()
    with runs.Folder() as folder:
        capture = small_capture(source, folder / "capture")
        usage(capture, folder)
        broken_captures(source, folder)
        run = requests(capture, folder)
        interrupted(run, signal.SIGINT)
        interrupted(run, signal.SIGTERM)
        ends_by_itself(run)
        resumed_by_mistake(run)
        from_other_folders(run, folder)
        evaluated(run, capture, folder)
        exported(run, capture, folder)


if __name__ == "__main__":
    sys.exit(main())
