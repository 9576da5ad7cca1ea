"""What was measured beside the bars that are set for two cores, and where a bar is missed,
the measured limit that stands before it.
usage: bars.py OUT        reads whichever of kernels.csv, work.csv, peer.csv and fox.csv are in OUT"""
import csv
import os
import sys


def rows(out, name):
    path = os.path.join(out, name)
    if not os.path.exists(path):
        return []
    with open(path) as file:
        return list(csv.DictReader(file))


def main():
    out = sys.argv[1]
    kernels, work, fox, peer = (rows(out, f"{name}.csv") for name in ("kernels", "work", "fox", "peer"))
    at = {row["figure"].split()[0]: row for row in work}
    table = []

    def bar(figure, wanted, value, unit, met, why=""):
        table.append((figure, wanted, f"{value}{unit}", "met" if met else f"missed: {why}"))

    def short(value, wanted, row):
        if not row:
            return f"{100 * (1 - value / wanted):.0f} % short"
        limit = float(row["at_limit"])
        side = "below the bar" if limit < wanted else "above it"
        return (f"with every sample in full, multiply-adds and memory allow {limit:.1f} M here, {side}; "
                f"{100 * (1 - value / wanted):.0f} % short")

    def rate(name, wanted, clock, processor, row):
        """By processor time where something else had the machine: a figure of the field, not of its company."""
        clock, processor = float(clock), float(processor)
        busy = clock < 0.85 * processor
        value = processor if busy else clock
        unit = " M samples/s by processor time (the machine was busy)" if busy else " M samples/s"
        bar(name, f">= {wanted}", f"{value:.2f}", unit, value >= wanted, short(value, wanted, row))

    if fox:
        last = fox[-1]
        rate("training, fox", 3, last["train_m_samples_per_s"], last["train_by_processor_time"], at.get("training"))
        rate("rendering, fox", 10, last["render_m_samples_per_s"], last["render_by_processor_time"],
             at.get("rendering"))
    for row in work:
        rate(row["figure"], 3 if row["figure"].startswith("training") else 10, row["m_samples_per_s"],
             row["by_processor_time"], row)
    mlp = [row for row in kernels if row["kernel"] == "MLP forward and backward"]
    if mlp:
        share = 100 * float(mlp[-1]["share"])
        bar(f"MLP forward and backward, {mlp[-1]['set']}", ">= 70 % of the multiply-add peak", f"{share:.0f}", " %",
            share >= 70,
            f"{70 - share:.0f} points short")
    if peer:
        ratio = float(peer[0]["ratio_by_processor_time"])
        bar("training in full, against PyTorch, by processor time", ">= 20x", f"{ratio:.1f}", "x", ratio >= 20,
            short(ratio, 20, None))
    for wanted, within in ((28.5, 60), (30.3, 200), (31.5, 600)):
        done = [row for row in fox if int(row["budget_s"]) <= within]
        if done:
            psnr = float(done[-1]["psnr"])
            bar(f"fox, held out, at {done[-1]['budget_s']} s", f">= {wanted} dB within {within} s", f"{psnr:.2f}",
                " dB", psnr >= wanted,
                f"{wanted - psnr:.2f} dB short, with the photos trained on at {done[-1]['train_psnr']} dB: "
                "what is missing lies between "
                "photos, not in time" if float(done[-1]["train_psnr"]) > wanted + 1
                else f"{wanted - psnr:.2f} dB short; speed is what it lacks")
    if fox:
        views, peak = float(last["views_per_s"]), max(float(row["peak_mb"]) for row in fox)
        bar("views of 320x180", ">= 5 a second", f"{views:.1f}", "", views >= 5,
            f"at {last['render_m_samples_per_s']} M samples a second, of which the limits are told above; "
            + short(views, 5, None))
        bar("peak memory of training, standard", "< 1500 MB", f"{peak:.0f}", " MB", peak < 1500, "too much")
    print("| figure | bar | measured | |\n|---|---|---|---|")
    for row in table:
        print("| " + " | ".join(row) + " |")


main()
