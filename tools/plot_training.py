#!/usr/bin/env python3
"""Draws the curves of a training run as one SVG: losses, occlusion radii, and what `ars eval` said of its checkpoints.

    tools/plot_training.py RUN --out curves.svg [--report STEP=report.json ...] [--set SET]

Reads RUN/metrics.jsonl. --set chooses a set of the reports by its name; without it the mean over all views is drawn.
"""
import argparse
import json
import math
import pathlib
import sys
from xml.sax.saxutils import escape

WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 520, 260, 56, 30, 160, 34
INKS = ["#3b7dd8", "#d9822b", "#3a9b5c", "#a14fbf", "#c2413b", "#6b7a8f", "#b59b1d", "#2a9d9d", "#8a5a44"]
QUALITY = {"radiance_psnr_mask": "radiance", "pbr_psnr_mask": "PBR", "albedo_psnr": "albedo", "relit_psnr_mask": "relit"}


def fail(sentence):
    sys.exit(f"error: {sentence}")


def read_metrics(path):
    """Rows of metrics.jsonl; of steps that were done twice (resumed) the later one counts."""
    rows = {}
    try:
        for number, line in enumerate(path.read_text().splitlines(), 1):
            try:
                row = json.loads(line)
                rows[row["step"]] = row
            except (ValueError, KeyError, TypeError):
                # The last line of a run that was killed may be half a line.
                print(f"warning: {path}, line {number}: not a step's metrics; left out", file=sys.stderr)
    except OSError as error:
        fail(f"{path}: {error.strerror}")
    if not rows:
        fail(f"{path}: no steps")
    return [rows[step] for step in sorted(rows)]


def smoothed(points, parts=120):
    """Means of about `parts` groups of neighbouring points."""
    size = max(1, len(points) // parts)
    groups = [points[i:i + size] for i in range(0, len(points), size)]
    return [(sum(p[0] for p in g) / len(g), sum(p[1] for p in g) / len(g)) for g in groups]


def ticks(low, high, wanted=5):
    span = high - low or 1.0
    step = 10.0 ** len(str(int(span))) if span >= 1 else 1.0
    while span / step < wanted:
        step /= 2 if str(step).lstrip("0.").startswith(("1", "2")) else 2.5
    first = int(low / step) * step
    values = [first + i * step for i in range(int(span / step) + 3)]
    return [v for v in values if low - 1e-9 <= v <= high + 1e-9]


class Scale:
    """Where values stand between the bottom (0) and the top (1) of a diagram: "zero" starts at 0, "range" fits the
    values, "log" has a step for each power of ten."""

    def __init__(self, kind, values):
        self.log = kind == "log"
        low, high = min(values), max(values)
        if self.log:
            low, high = math.log10(max(low, 1e-6)), math.log10(high)
        margin = 0.06 * (high - low or 1.0)
        self.low, self.high = (0.0 if kind == "zero" else low - margin), high + margin

    def __call__(self, value):
        value = math.log10(max(value, 1e-6)) if self.log else value
        return min(1.0, max(0.0, (value - self.low) / (self.high - self.low)))

    def ticks(self):
        if not self.log:
            return ticks(self.low, self.high)
        return [10.0 ** p for p in range(math.ceil(self.low), math.floor(self.high) + 1)]


def spread(ends, bottom):
    """Names at their curves' ends, moved so that none lies over another or below the diagram."""
    ends.sort()
    for i in range(1, len(ends)):
        ends[i][0] = max(ends[i][0], ends[i - 1][0] + 13)
    for i in reversed(range(len(ends))):
        ends[i][0] = min(ends[i][0], bottom - 13 * (len(ends) - 1 - i))


def panel(title, unit, curves, last_step, index, kind):
    """SVG of one diagram; `curves` maps names to lists of (step, value)."""
    scale = Scale(kind, [v for points in curves.values() for _, v in points])
    x0, y0 = (index % 2) * WIDTH, (index // 2) * HEIGHT
    inner_width, inner_height = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def place(step, value):
        x = x0 + LEFT + inner_width * step / last_step
        return x, y0 + TOP + inner_height * (1.0 - scale(value))

    out = [f'<text x="{x0 + LEFT}" y="{y0 + 18}" class="title">{escape(title)}{escape(", " + unit if unit else "")}</text>']
    for value in scale.ticks():
        x, y = place(0, value)
        out.append(f'<path d="M{x:.1f} {y:.1f}h{inner_width}" class="grid"/>'
                   f'<text x="{x - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    for step in ticks(0, last_step, 4):
        x, y = place(step, 0)[0], y0 + HEIGHT - BOTTOM
        out.append(f'<text x="{x:.1f}" y="{y + 16}" text-anchor="middle">{step:g}</text>')
    ends = []
    for (name, points), ink in zip(curves.items(), INKS):
        path = "L".join("{:.1f} {:.1f}".format(*place(*p)) for p in points)
        out.append(f'<path d="M{path}" fill="none" stroke="{ink}" stroke-width="1.6"/>')
        ends.append([place(*points[-1])[1], name, ink])
    spread(ends, y0 + HEIGHT - BOTTOM)
    for end in ends:
        out.append(f'<text x="{x0 + WIDTH - RIGHT + 6}" y="{end[0] + 4:.1f}" style="fill:{end[2]}">{escape(end[1])}</text>')
    return "".join(out)


def columns(rows, prefix, smooth=True):
    names = sorted({key for row in rows for key in row if key.startswith(prefix)})
    curves = {n[len(prefix):]: [(row["step"], row[n]) for row in rows if n in row] for n in names}
    return {n: smoothed(points) if smooth else points for n, points in curves.items()}


def quality(reports, chosen):
    curves = {}
    for step, path in sorted(reports):
        try:
            report = json.loads(pathlib.Path(path).read_text())
            mean = report["mean"]
            if chosen:
                mean = next(s["mean"] for s in report["sets"] if s["name"] == chosen)
        except (OSError, ValueError, KeyError) as error:
            fail(f"{path}: expected a report of ars eval ({error})")
        except StopIteration:
            fail(f'{path}: there is no set "{chosen}"')
        for key, name in QUALITY.items():
            if mean.get(key) is not None:
                curves.setdefault(name, []).append((step, mean[key]))
    return curves


def step_and_path(text):
    step, _, path = text.partition("=")
    if not step.isdigit() or not path:
        raise argparse.ArgumentTypeError(f'expected STEP=FILE, found "{text}"')
    return int(step), path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--report", type=step_and_path, action="append", default=[])
    parser.add_argument("--set", default="")
    options = parser.parse_args()
    rows = read_metrics(options.run / "metrics.jsonl")
    last = max([rows[-1]["step"]] + [step for step, _ in options.report])
    losses = columns(rows, "loss.")
    pictures = {n: p for n, p in losses.items() if n in ("l1", "radiance_l1")}
    others = {n: p for n, p in losses.items() if n not in pictures and n != "total" and max(v for _, v in p) > 0}
    radii = {n: [(s, 100 * v) for s, v in p] for n, p in columns(rows, "radius.").items()}
    panels = [("Mean difference of the pictures", "", pictures, "zero"), ("Other terms, weighted", "", others, "log"),
              ("Occlusion radii", "cm", radii, "zero"),
              (f"Quality{', ' + options.set if options.set else ''}", "dB", quality(options.report, options.set), "range")]
    panels = [p for p in panels if p[2]]
    body = "".join(panel(title, unit, curves, last, i, kind) for i, (title, unit, curves, kind) in enumerate(panels))
    width, height = WIDTH * min(2, len(panels)), HEIGHT * ((len(panels) + 1) // 2)
    style = ("text{font:11px sans-serif;fill:#444}.title{font-weight:bold;font-size:12px;fill:#222}"
             ".grid{stroke:#e3e3e3;stroke-width:1}")
    options.out.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
                           f'viewBox="0 0 {width} {height}"><style>{style}</style>'
                           f'<rect width="100%" height="100%" fill="white"/>{body}</svg>\n')


if __name__ == "__main__":
    main()
