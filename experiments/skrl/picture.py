"""Learning curves with their bands as an SVG: a row for each task, a column for each algorithm."""

WIDTH, HEIGHT, GAP, LEFT, TOP = 190, 130, 34, 44, 40
COLORS = {"mishandle": "#1f6fb4", "skrl": "#d1662a"}
# Readable on a light and on a dark page.
TEXT = 'font-family="sans-serif" font-size="11" fill="#808080"'


def ticks(low, high):
    """A few round numbers from `low` to `high`."""
    step = 10.0 ** len(str(int(high - low))) / 10
    while (high - low) / step < 3:
        step /= 2
    first = -int(-low // step)
    return [step * i for i in range(first, int(high // step) + 1)]


def panel(found, left, top):
    bands, steps = found["bands"], found["environment_steps"]
    low = min(min(band["low"]) for band in bands.values())
    high = max(max(band["high"]) for band in bands.values())
    low, high = low - 0.05 * (high - low) - 0.01, high + 0.05 * (high - low) + 0.01
    x = lambda value: left + WIDTH * value / steps[-1]
    y = lambda value: top + HEIGHT * (high - value) / (high - low)
    points = lambda pairs: " ".join(f"{x(a):.1f},{y(b):.1f}" for a, b in pairs)
    parts = [f'<rect x="{left}" y="{top}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#808080"/>']
    for side, band in bands.items():
        around = [*zip(steps, band["low"]), *reversed([*zip(steps, band["high"])])]
        parts.append(f'<polygon points="{points(around)}" fill="{COLORS[side]}" fill-opacity="0.25"/>')
        mean = points(zip(steps, band["mean"]))
        parts.append(f'<polyline points="{mean}" fill="none" stroke="{COLORS[side]}" stroke-width="1.5"/>')
    for value in ticks(low, high):
        parts.append(f'<text x="{left - 4}" y="{y(value) + 4:.1f}" text-anchor="end" {TEXT}>{value:g}</text>')
    end = f"{steps[-1] / 1000:.0f}k"
    parts.append(f'<text x="{left + WIDTH}" y="{top + HEIGHT + 13}" text-anchor="end" {TEXT}>{end}</text>')
    name = f"{found['algorithm'].upper()}, {found['task']}"
    parts.append(f'<text x="{left}" y="{top - 5}" {TEXT}>{name} ({len(found["seeds"])} seeds)</text>')
    return parts


def draw(all_found, tasks, algorithms):
    """The picture as text."""
    parts = []
    for found in all_found:
        row, column = tasks.index(found["task"]), algorithms.index(found["algorithm"])
        parts += panel(found, LEFT + column * (WIDTH + GAP), TOP + row * (HEIGHT + GAP))
    for place, (side, color) in enumerate(COLORS.items()):
        left = LEFT + 90 * place
        parts.append(f'<rect x="{left}" y="8" width="14" height="8" fill="{color}"/>')
        parts.append(f'<text x="{left + 18}" y="16" {TEXT}>{side}</text>')
    words = "mean return of training episodes against environment steps; interquartile mean over seeds, 95 % band"
    parts.append(f'<text x="{LEFT + 190}" y="16" {TEXT}>{words}</text>')
    size = LEFT + len(algorithms) * (WIDTH + GAP), TOP + len(tasks) * (HEIGHT + GAP)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}" height="{size[1]}">'
    return "\n".join([head, *parts, "</svg>"]) + "\n"
