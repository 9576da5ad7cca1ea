"""Opens a project in QGIS without a screen: layers, places, pixels. Draws the map.

usage: QT_QPA_PLATFORM=offscreen python3 qgis_project.py CITY.qgs CITY/frame.json MAP.png PHOTOS TILES LIGHT EPSG
"""
import json
import os
import sys

from qgis.core import (QgsApplication, QgsCoordinateReferenceSystem, QgsCoordinateTransform,
                       QgsMapRendererParallelJob, QgsMapSettings, QgsPointXY, QgsProject)
from qgis.PyQt.QtCore import QSize

path, frame, picture, photos, tiles, light, epsg = sys.argv[1:]
QgsApplication.setPrefixPath("/usr", True)
app = QgsApplication([], False)
app.initQgis()
project = QgsProject.instance()
assert project.read(path), project.error()
layers = {layer.name(): layer for layer in project.mapLayers().values()}
assert set(layers) >= {"Orthophoto", "Surface model", "Tiles", "Photos"}, set(layers)
for name, layer in layers.items():
    assert layer.isValid(), name
    assert layer.crs().isValid(), name
    assert os.path.dirname(path) in os.path.abspath(layer.source()), layer.source()
assert project.crs().authid() == layers["Orthophoto"].crs().authid() == "EPSG:" + epsg
assert layers["Photos"].featureCount() == int(photos) and layers["Tiles"].featureCount() == int(tiles)
assert "light: " + light in project.metadata().abstract()

origin = json.load(open(frame))["origin"]
turn = QgsCoordinateTransform(QgsCoordinateReferenceSystem("EPSG:4326"), project.crs(), project)
place = turn.transform(QgsPointXY(origin["longitude_deg"], origin["latitude_deg"]))
for layer in layers.values():
    box = QgsCoordinateTransform(layer.crs(), project.crs(), project).transformBoundingBox(layer.extent())
    assert box.contains(place), layer.name()
height, found = layers["Surface model"].dataProvider().sample(place, 1)
# Of the tiles, not of the origin: photos from the air have theirs at the height of the cameras.
plan = json.load(open(os.path.join(os.path.dirname(frame), "plan", "plan.json")))
middle = origin["height_m"] + sum(tile["centre"][2] for tile in plan["tiles"]) / len(plan["tiles"])
assert found and abs(height - middle) < 30, (height, middle)

settings = QgsMapSettings()
settings.setLayers(project.layerTreeRoot().checkedLayers())
assert len(settings.layers()) == 3
settings.setDestinationCrs(project.crs())
settings.setExtent(layers["Orthophoto"].extent())
settings.setOutputSize(QSize(600, 600))
job = QgsMapRendererParallelJob(settings)
job.start()
job.waitForFinished()
image = job.renderedImage()
assert image.save(picture)
colours = {image.pixel(x, y) for x in range(0, 600, 7) for y in range(0, 600, 7)}
assert len(colours) > 500, len(colours)
print(f"QGIS opens {len(layers)} layers; the surface at the origin is {height:.2f} m high")
app.exitQgis()
