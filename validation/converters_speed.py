"""Raw file to JPEG with defaults, beside darktable-cli and rawtherapee-cli: wall and processor seconds, medians, turn by turn in one run.

    apt install darktable rawtherapee
    python validation/converters_speed.py target/release/diopter RAW.dng [ROUNDS]
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time


def main():
    diopter, raw, rounds = sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 5
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "out.jpg")
        commands = {
            "diopter develop": [diopter, "develop", raw, "-o", out],
            "rawtherapee-cli": ["rawtherapee-cli", "-Y", "-d", "-j92", "-js3", "-o", out, "-c", raw],
            "darktable-cli": ["darktable-cli", raw, out, "--core", "--configdir", os.path.join(folder, "dt"), "--library", ":memory:"],
        }
        times = {name: [] for name in commands}
        for _ in range(rounds):
            for name, command in commands.items():
                if os.path.exists(out):
                    os.remove(out)
                before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
                subprocess.run(command, check=True, capture_output=True)
                wall = time.time() - started
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                times[name].append((wall, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, os.path.getsize(out)))
        first = statistics.median(t[0] for t in times["diopter develop"])
        for name, t in times.items():
            wall, cpu = (statistics.median(x[k] for x in t) for k in (0, 1))
            print(f"{name:18} wall {wall:6.2f} s   processor {cpu:6.2f} s   {t[0][2] / 1e6:5.1f} MB   {wall / first:5.2f} × ours")


main()
