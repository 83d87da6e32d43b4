#!/usr/bin/env python3
"""Draws one scene with VTK and times it; tools/peers calls it in its own Python environment.

    peer_vtk.py SCENE.json --mapper fixed|gpu [--out PICTURE.png] [--frames N]

The scene is one of holocast's (docs/scene-format.md) with a camera, a size, a step and a NIfTI volume, of the modes
emission-absorption (dvr) or maximum (mip). Prints one line of JSON: the least and the median milliseconds of a frame with
read-back, after a first one that is not counted.
"""
import argparse, json, pathlib, statistics, time
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy


def load(path):
    import nibabel
    image = nibabel.load(str(path))
    data = np.asanyarray(image.dataobj)
    if data.ndim == 4:
        data = data[..., 0]
    if data.dtype == np.float64:
        data = data.astype(np.float32)
    return np.ascontiguousarray(data.transpose(2, 1, 0)), [float(z) for z in image.header.get_zooms()[:3]]


def main():
    p = argparse.ArgumentParser()
    p.add_argument("scene", type=pathlib.Path)
    p.add_argument("--mapper", choices=["fixed", "gpu"], required=True)
    p.add_argument("--out", type=pathlib.Path)
    p.add_argument("--frames", type=int, default=7)
    a = p.parse_args()
    scene = json.loads(a.scene.read_text())
    data, spacing = load(a.scene.parent / scene["volume"])

    image = vtk.vtkImageData()
    image.SetDimensions(data.shape[2], data.shape[1], data.shape[0])
    image.SetSpacing(*spacing)
    image.GetPointData().SetScalars(numpy_to_vtk(data.ravel(), deep=1))

    color, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    for value, r, g, b, o in scene["transfer"]:
        color.AddRGBPoint(value, r, g, b)
        opacity.AddPoint(value, o)
    prop = vtk.vtkVolumeProperty()
    prop.SetColor(color)
    prop.SetScalarOpacity(opacity)
    prop.SetScalarOpacityUnitDistance(1.0)
    prop.SetInterpolationTypeToLinear()
    light = scene.get("light") or (scene.get("shade") and {"ambient": 0.15, "diffuse": 0.65, "specular": 0.2, "power": 1})
    if light:
        prop.ShadeOn()
        prop.SetAmbient(light["ambient"])
        prop.SetDiffuse(light["diffuse"])
        prop.SetSpecular(light["specular"])
        prop.SetSpecularPower(light["power"])
    else:
        prop.ShadeOff()

    mapper = vtk.vtkFixedPointVolumeRayCastMapper() if a.mapper == "fixed" else vtk.vtkGPUVolumeRayCastMapper()
    mapper.AutoAdjustSampleDistancesOff()
    mapper.SetSampleDistance(scene["step_mm"])
    mapper.SetImageSampleDistance(1.0)
    if scene.get("mode") in ("mip", "maximum"):
        mapper.SetBlendModeToMaximumIntensity()
    mapper.SetInputData(image)
    volume = vtk.vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(prop)
    ren = vtk.vtkRenderer()
    ren.SetBackground(*scene.get("background", [0, 0, 0]))
    ren.AddVolume(volume)
    win = vtk.vtkRenderWindow()
    win.SetOffScreenRendering(1)
    win.SetMultiSamples(0)
    win.SetSize(*scene["size"])
    win.AddRenderer(ren)
    cam = ren.GetActiveCamera()
    c = scene["camera"]
    cam.SetPosition(*c["eye"]); cam.SetFocalPoint(*c["target"]); cam.SetViewUp(*c["up"]); cam.SetViewAngle(c["fov_y_deg"])
    ren.ResetCameraClippingRange()
    win.Render()

    times, pixels = [], vtk.vtkUnsignedCharArray()
    w, h = scene["size"]
    for _ in range(a.frames):
        cam.Modified(); volume.Modified()
        start = time.perf_counter()
        win.Render()
        win.GetRGBACharPixelData(0, 0, w - 1, h - 1, 0, pixels)
        times.append((time.perf_counter() - start) * 1e3)
    rgba = vtk_to_numpy(pixels).reshape(h, w, 4)[::-1]
    if a.out:
        writer = vtk.vtkPNGWriter()
        flat = vtk.vtkImageData(); flat.SetDimensions(w, h, 1)
        flat.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(rgba[::-1, :, :3]).reshape(-1, 3), deep=1))
        writer.SetFileName(str(a.out)); writer.SetInputData(flat); writer.Write()
    print(json.dumps({"peer": f"VTK {vtk.vtkVersion().GetVTKVersion()} {type(mapper).__name__}", "window": win.GetClassName(),
                      "size": [w, h], "dims": list(data.shape[::-1]), "frame_ms_min": round(min(times), 2),
                      "frame_ms_median": round(statistics.median(times), 2), "mean_level": round(float(rgba[..., :3].mean()), 3)}))


if __name__ == "__main__":
    main()
