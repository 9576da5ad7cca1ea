"""Fox at 270 pixels, every 8th photo held out, from photos to a held-out score: one training for each
budget of seconds, as `conurb train --time-budget` gives it, and then what it reached; evaluation is not part of
the time. Writes fox.csv and prints the table.
usage: fox.py CONURB BENCH_VIEW OUT [SECONDS ...]        needs CONURB_DATA/fox; 77 without"""
import json
import os
import shutil
import subprocess
import sys


def train(conurb, city, seconds):
    """Trains anew within the budget: metrics (with the speed by processor time added), and the peak
    memory of the process in MB."""
    shutil.rmtree(f"{city}/tiles", ignore_errors=True)
    shutil.rmtree(f"{city}/eval", ignore_errors=True)
    with open(os.devnull, "w") as quiet:
        child = subprocess.Popen([conurb, "train", city, "--time-budget", f"{seconds}s"], stderr=quiet)
        _, status, usage = os.wait4(child.pid, 0)
    if status:
        sys.exit(f"fox.py: training failed; run `{conurb} train {city} --time-budget {seconds}s` to see why")
    (tile,) = os.listdir(f"{city}/tiles")
    with open(f"{city}/tiles/{tile}/metrics.json") as file:
        metrics = json.load(file)
    ran = (usage.ru_utime + usage.ru_stime) / len(os.sched_getaffinity(0))
    metrics["by_processor_time"] = metrics["samples_per_s"] * metrics["seconds"] / ran
    return metrics, usage.ru_maxrss / 1024


def main():
    conurb, view, out = sys.argv[1:4]
    budgets = [int(s) for s in sys.argv[4:]] or [15, 30, 60, 120, 200, 300, 600]
    here = os.path.dirname(os.path.abspath(__file__))
    fox = os.path.join(os.environ.get("CONURB_DATA", f"{here}/../../../shared/data"), "fox")
    if not os.path.exists(f"{fox}/transforms.json"):
        print("skipped: no fox photos under CONURB_DATA", file=sys.stderr)
        sys.exit(77)
    city = f"{out}/city-fox"
    quiet = {"check": True, "stderr": subprocess.DEVNULL}
    shutil.rmtree(city, ignore_errors=True)
    subprocess.run([conurb, "init", city, "--photos", fox, "--import", f"{fox}/transforms.json", "--width", "270"],
                   **quiet)
    subprocess.run([conurb, "poses", city], **quiet)
    subprocess.run([conurb, "plan", city, "--no-forecast"], **quiet)
    print("| budget s | trained s | steps | held-out PSNR | SSIM | training M samples/s "
          "| by processor time | peak MB | training PSNR | views/s, 320x180 "
          "| rendering M samples/s | by processor time |")
    print("|---" * 12 + "|", flush=True)
    with open(f"{out}/fox.csv", "w") as csv:
        print("budget_s,seconds,steps,psnr,ssim,train_m_samples_per_s,train_by_processor_time,peak_mb,train_psnr,"
              "views_per_s,render_m_samples_per_s,render_by_processor_time", file=csv)
        for seconds in budgets:
            metrics, peak = train(conurb, city, seconds)
            score = json.loads(subprocess.run([conurb, "eval", city, "--json"], stdout=subprocess.PIPE, **quiet).stdout)
            speed = subprocess.run([view, city], stdout=subprocess.PIPE, check=True, text=True).stdout.split()
            row = (str(seconds), f"{metrics['seconds']:.1f}", str(metrics["steps"]), f"{score['psnr']:.2f}",
                   f"{score['ssim']:.3f}",
                   f"{metrics['samples_per_s'] / 1e6:.2f}", f"{metrics['by_processor_time'] / 1e6:.2f}", f"{peak:.0f}",
                   f"{metrics['train_psnr']:.2f}", *speed[:3])
            print("| " + " | ".join(row) + " |", flush=True)
            print(",".join(row), file=csv, flush=True)


main()
