"""Small cities for the tests of `conurb view`."""
import os
import re
import subprocess


def quiet_run(command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{command}: {done.stderr}")


def change(folder, change_text):
    """Changes city.yaml."""
    with open(f"{folder}/city.yaml", encoding="utf-8") as file:
        text = change_text(file.read())
    with open(f"{folder}/city.yaml", "w", encoding="utf-8") as file:
        file.write(text)


def new_city(conurb, make_photos, folder, gps):
    """A city of which nothing is done; its photos are in FOLDER-photos. gps: photos with it: all, some, none."""
    photos = f"{folder}-photos"
    os.mkdir(photos)
    quiet_run([make_photos, photos, "9", gps])
    quiet_run([conurb, "init", folder, "--photos", photos, "--import", f"{photos}/transforms.json", "--width", "48"])

    def small(text):
        text = text.replace("train:\n", "train:\n  steps: 60\n  samples_per_step: 8192\n", 1)
        return re.sub(r"(?m)^field:.*$", "field:\n  log2_table: 12\n  levels: 6\n  finest_resolution: 128", text)

    change(folder, small)
    return folder


def made_city(conurb, make_photos, folder, gps):
    """The same, planned but not trained."""
    new_city(conurb, make_photos, folder, gps)
    quiet_run([conurb, "poses", folder])
    quiet_run([conurb, "plan", folder])
    return folder
