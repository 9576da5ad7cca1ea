"""Opens a textured mesh in Blender, checks its image and takes a picture.

usage: blender -b --factory-startup --python-exit-code 1 -P mesh.py -- MESH.glb|MESH.obj PICTURE.png
"""
import builtins
import math
import sys

import bpy
import mathutils
import numpy

# Blender 3.4's reader of glTF uses names that newer numpy lacks.
for name in ("bool", "int", "float", "object"):
    if not hasattr(numpy, name):
        setattr(numpy, name, getattr(builtins, name))

path, picture = sys.argv[sys.argv.index("--") + 1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
if path.endswith(".glb"):
    bpy.ops.import_scene.gltf(filepath=path)
else:
    bpy.ops.wm.obj_import(filepath=path, forward_axis="Y", up_axis="Z")
meshes = [o for o in bpy.context.scene.objects if o.type == "MESH"]
images = [n.image for o in meshes for m in o.data.materials for n in m.node_tree.nodes if n.type == "TEX_IMAGE"]
assert images and all(i.size[0] >= 64 for i in images), images
pixels = numpy.array(images[0].pixels[:]).reshape(-1, 4)[:, :3]
assert pixels.std() > 0.05, "the texture has one colour"
places = numpy.array([o.matrix_world @ v.co for o in meshes for v in o.data.vertices])
assert all(len(o.data.uv_layers) == 1 for o in meshes)
middle, span = numpy.median(places, axis=0), numpy.percentile(places, 95, axis=0) - numpy.percentile(places, 5, axis=0)
assert span[2] < span[0] and span[2] < span[1], "the city does not lie flat"

scene = bpy.context.scene
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(camera)
away = mathutils.Vector((0.4, -0.65, 0.65)).normalized()
camera.location = mathutils.Vector(middle) + away * float(max(span[:2]))
camera.rotation_euler = (-away).to_track_quat("-Z", "Y").to_euler()
camera.data.angle = math.radians(50)
camera.data.clip_end = 1e4
for o in meshes: # light of their own, as the glTF says; an OBJ cannot say so
    for material in o.data.materials:
        nodes, links = material.node_tree.nodes, material.node_tree.links
        glow, image = nodes.new("ShaderNodeEmission"), next(n for n in nodes if n.type == "TEX_IMAGE")
        links.new(image.outputs["Color"], glow.inputs["Color"])
        links.new(glow.outputs[0], next(n for n in nodes if n.type == "OUTPUT_MATERIAL").inputs["Surface"])
scene.camera, scene.render.engine = camera, "CYCLES"
scene.cycles.samples, scene.cycles.max_bounces, scene.cycles.use_denoising = 4, 0, False
scene.render.resolution_x, scene.render.resolution_y, scene.render.filepath = 480, 320, picture
scene.view_settings.view_transform = "Standard"
bpy.ops.render.render(write_still=True)
shown = bpy.data.images.load(picture)
lit = numpy.array(shown.pixels[:]).reshape(-1, 4)[:, :3].max(axis=1) > 0.1
assert lit.mean() > 0.2, lit.mean()
print(f"Blender has {len(places)} vertices, {len(images)} textures; the mesh covers {100 * lit.mean():.0f} % of a view")
