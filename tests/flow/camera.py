"""Opens a flight's cameras in Blender and compares them with places and directions that are known.

usage: blender -b --factory-startup --python-exit-code 1 -P camera.py -- FLIGHT.glb FLIGHT.chan
"""
import math
import sys

import addon_utils
import bpy
from mathutils import Vector

glb, chan = sys.argv[-2:]
scene = bpy.context.scene
scene.render.fps = 24
for thing in list(bpy.data.objects):
    bpy.data.objects.remove(thing)
bpy.ops.import_scene.gltf(filepath=glb)
(flown,) = (thing for thing in bpy.data.objects if thing.type == "CAMERA")
lens = bpy.data.cameras.new("chan")
read = bpy.data.objects.new("chan", lens)
scene.collection.objects.link(read)
bpy.context.view_layer.objects.active = read
addon_utils.enable("io_anim_nuke_chan")
bpy.ops.import_scene.import_chan(filepath=chan, z_up=True, rotation_order="ZXY")


def pose(camera):
    """Place, direction and up of a camera; Blender has z up, as the city's local metres have."""
    m = camera.matrix_world
    return m.translation.copy(), -m.col[2].xyz.normalized(), m.col[1].xyz.normalized()


worst = 0
for frame in range(25):
    scene.frame_set(frame)
    for a, b in zip(pose(flown), pose(read)):
        worst = max(worst, (a - b).length)
    assert worst < 1e-4, (frame, pose(flown), pose(read))
h, p, r = math.radians(90), math.radians(-30), math.radians(10)
known = {0: (Vector((30, -12.5, 60)), Vector((math.cos(p), 0, math.sin(p)))),
         24: (Vector((-40.25, 20, 40)), Vector((0, 0, -1)))}
for frame, (place, forward) in known.items():
    scene.frame_set(frame)
    found = pose(flown)
    assert (found[0] - place).length < 1e-4 and (found[1] - forward).length < 1e-5, (frame, found)
scene.frame_set(0)
up = Vector((0.5 * math.cos(r), -math.sin(r), math.cos(p) * math.cos(r)))  # rolled clockwise: to the south
assert (pose(flown)[2] - up).length < 1e-5, pose(flown)
print(f"Blender has the flight's cameras; .glb and .chan differ by {worst:.2g}")
