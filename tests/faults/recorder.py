"""`cnnum record`, started many times over: one process imports it, and forks a child for each.

A job is a line of JSON on standard input; the answers are the child's process id at once, and its
exit code (negative: the signal) when it has ended. Keys of a job: "arguments" of `cnnum`, and
"said" (the file for both its outputs). Others are not needed:

"log"      file that the moment of each frame is written to
"pause"    s before each frame
"stall"    frames after which the array says nothing more
"limit"    bytes of a file, at most
"appears"  file that another program makes meanwhile
"disk"     folder that a file system of "size" bytes is mounted on
"copy"     folder that its files go to
"""

import json
import os
import resource
import shutil
import signal
import struct
import subprocess
import sys
import time
import traceback
from pathlib import Path

from cnnum.cli import main
from cnnum.cli.commands import record, recover
from cnnum.drivers import npz_file, recording_file
from cnnum.drivers.simulated import array

IMPORTED = (record, recover, recording_file, npz_file, array)


def limited(job):
    """Return the source of frames, which notes the moment at which it hands each one on."""
    real, stall = record.limited, job.get("stall", float("inf"))

    def frames(driver, seconds, count):
        log = os.open(job["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        for number, frame in enumerate(real(driver, seconds, count)):
            if number >= stall:
                time.sleep(1000)
            time.sleep(job.get("pause", 0.0))
            os.write(log, struct.pack("<q", time.monotonic_ns()))
            if number == 3 and "appears" in job:
                Path(job["appears"]).write_text("of another program")
            yield frame

    return frames


def run(job):
    said = os.open(job["said"], os.O_WRONLY | os.O_CREAT)
    os.dup2(said, 1)
    os.dup2(said, 2)
    for number in (signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if "limit" in job:
        resource.setrlimit(resource.RLIMIT_FSIZE, (job["limit"], resource.RLIM_INFINITY))
    if "log" in job:
        record.limited = limited(job)
    main(job["arguments"])


def answer(job):
    pid = os.fork()
    if pid == 0:
        try:
            run(job)
        except SystemExit as end:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(end.code or 0)
        except BaseException:
            traceback.print_exc()
            os._exit(70)
    print(pid, flush=True)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def answer_on_disk(job):
    """Mount a disk of its own for the job, and keep its files in the end."""
    disk = job["disk"]
    mount = ["mount", "-t", "tmpfs", "-o", f"size={job['size']}", "none", disk]
    subprocess.run(mount, check=True)
    try:
        return answer(job)
    finally:
        shutil.copytree(disk, job["copy"])
        subprocess.run(["umount", disk], check=True)


for line in sys.stdin:
    asked = json.loads(line)
    print(answer_on_disk(asked) if "disk" in asked else answer(asked), flush=True)
