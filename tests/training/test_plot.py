"""tools/plot_training.py: a curve for each column, a step that was done twice counts once, and errors in one sentence."""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

TOOL = pathlib.Path(__file__).resolve().parents[2] / "tools" / "plot_training.py"


def plot(*arguments):
    return subprocess.run([sys.executable, TOOL, *map(str, arguments)], capture_output=True, text=True)


def ends(svg, name):
    """Ordinate of the last point of the curve that ends at a name."""
    ink = re.search(rf'style="fill:(#\w+)">{name}<', svg).group(1)
    path = re.findall(rf'<path d="M([^"]+)" fill="none" stroke="{ink}"', svg)[0]
    return [float(point.split()[1]) for point in path.split("L")]


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        run = folder / "run"
        run.mkdir()
        rows = [{"step": s, "loss.l1": 1.0 / s, "loss.offset": 1e-4, "loss.total": 1.0, "radius.hip": 0.2}
                for s in (1, 2, 3, 4)]
        rows += [{"step": 4, "loss.l1": 1.0, "loss.offset": 1e-4, "loss.total": 1.0, "radius.hip": 0.4}]
        (run / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows) + '{"step": 5, "lo')
        report = folder / "report.json"
        report.write_text(json.dumps({"mean": {"pbr_psnr_mask": 20.0, "albedo_psnr": None},
                                      "sets": [{"name": "novel", "mean": {"pbr_psnr_mask": 25.0}}]}))
        out = folder / "curves.svg"
        done = plot(run, "--out", out, "--report", f"2={report}", "--report", f"4={report}", "--set", "novel")
        assert done.returncode == 0, done.stderr
        assert "line 6: not a step's metrics" in done.stderr, done.stderr
        svg = out.read_text()
        for word in ("Mean difference", "Other terms", "Occlusion radii, cm", "Quality, novel", ">hip<", ">PBR<"):
            assert word in svg, f"no {word}"
        assert ">albedo<" not in svg and ">total<" not in svg
        heights = ends(svg, "l1")
        # Downwards is less: from 1 to 1/3, and the second row of step 4 is 1 again.
        assert len(heights) == 4 and heights[0] == heights[3] < heights[1] < heights[2], heights

        for arguments, words in (((run, "--out", out, "--report", f"2={report}", "--set", "other"), 'no set "other"'),
                                 ((folder / "none", "--out", out), "No such file"),
                                 ((run, "--out", out, "--report", "2"), "STEP=FILE")):
            failed = plot(*arguments)
            assert failed.returncode != 0 and words in failed.stderr, failed.stderr
            assert "Traceback" not in failed.stderr


if __name__ == "__main__":
    sys.exit(main())
