"""Pictures by VTK's CPU ray caster, with their cost: the other side of `supervol bench --peers`.

    python vtk_render.py JOB.json ANSWER.json

JOB.json names one volume (a file that numpy.load reads, indices z, y, x, values in the data's own units), its place in the
world, one camera, one transfer function, one shading and a list of step lengths; all lengths are world lengths, angles are
degrees. For each step the volume is drawn once to warm up, then `repeats` times with the clock running. Pictures are
written as the rays gathered them (see `write_picture`). ANSWER.json holds versions and numbers, or `error`: why there are none.

vtkFixedPointVolumeRayCastMapper casts rays on the processor with 15-bit fixed-point numbers, skips empty 4^3 cells, and
ends a ray whose remaining opacity is below 255/32768; its finished picture goes through OpenGL as one textured rectangle.
Render() is timed as a whole, and RenderSubVolume(), which is the ray casting alone, once more by itself.
"""

import json
import sys
import time


def read_volume(job):
    """The voxels as vtkImageData: point (i, j, k) of the grid is the centre of voxel (i, j, k)."""
    import numpy
    import vtk
    from vtk.util import numpy_support

    nx, ny, nz = job["dims"]
    voxels = numpy.load(job["voxels"])
    if voxels.shape != (nz, ny, nx):
        raise ValueError(f"{job['voxels']} has the shape {voxels.shape} instead of {(nz, ny, nx)}")
    image = vtk.vtkImageData()
    image.SetDimensions(nx, ny, nz)
    image.SetSpacing(*job["spacing"])
    image.SetOrigin(0.0, 0.0, 0.0)
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(voxels.ravel(), deep=True))
    return image


def place(job):
    """The rest of the way to the world: x = origin + direction * (spacing * index), direction row by row."""
    import vtk

    matrix = vtk.vtkMatrix4x4()
    for row in range(3):
        for column in range(3):
            matrix.SetElement(row, column, job["direction"][3 * row + column])
        matrix.SetElement(row, 3, job["origin"][row])
    return matrix


def volume_property(job):
    """Classification and shading."""
    import vtk

    opacity, color = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
    for point in job["transfer_function"]["points"]:
        opacity.AddPoint(point["value"], point["alpha"])
        color.AddRGBPoint(point["value"], *point["color"])
    prop = vtk.vtkVolumeProperty()
    prop.SetScalarOpacity(opacity)
    prop.SetColor(color)
    prop.SetScalarOpacityUnitDistance(job["transfer_function"]["unit_distance"])
    prop.SetInterpolationTypeToLinear()
    shading = job["shading"]
    if shading is None:
        prop.ShadeOff()
    else:
        prop.ShadeOn()
        prop.SetAmbient(shading["ambient"])
        prop.SetDiffuse(shading["diffuse"])
        prop.SetSpecular(shading["specular"])
        prop.SetSpecularPower(shading["shininess"])
    return prop


def ray_caster(job, image):
    """The CPU mapper with everything switched off that would trade quality for speed behind our back."""
    import vtk

    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.SetBlendModeToComposite()
    mapper.AutoAdjustSampleDistancesOff()
    mapper.LockSampleDistanceToInputSpacingOff()
    mapper.IntermixIntersectingGeometryOff()
    mapper.SetImageSampleDistance(1.0)
    mapper.SetNumberOfThreads(job["threads"])
    return mapper


def window_of(job, mapper):
    """An off-screen window that holds the volume alone, seen by the job's camera and lit from the eye."""
    import vtk

    volume = vtk.vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(volume_property(job))
    volume.SetUserMatrix(place(job))
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(0.0, 0.0, 0.0)
    renderer.AddVolume(volume)
    # VTK takes the ambient term from the light, and a light's ambient colour is black unless somebody says otherwise.
    light = vtk.vtkLight()
    light.SetLightTypeToHeadlight()
    light.SetAmbientColor(1.0, 1.0, 1.0)
    renderer.AddLight(light)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*job["camera"]["eye"])
    camera.SetFocalPoint(*job["camera"]["target"])
    camera.SetViewUp(*job["camera"]["up"])
    camera.SetViewAngle(job["camera"]["fov_y"])
    renderer.ResetCameraClippingRange()
    return window, renderer, volume


def write_picture(mapper, path):
    """What the rays gathered: premultiplied RGBA, 16-bit little endian, 32767 is 1, row 0 on top, the whole viewport.

    Taken from the ray caster, not from the window: the window's picture is stretched by a pixel on its way through OpenGL
    and rounded to 8 bits, which is no fault of the rays. The ray caster keeps only the rectangle around the volume, row 0
    at the bottom, in a buffer of a size of its own.
    """
    import ctypes

    import numpy

    kept = mapper.GetRayCastImage()
    width, height = kept.GetImageViewportSize()
    buffer_width, buffer_height = kept.GetImageMemorySize()
    used_width, used_height = kept.GetImageInUseSize()
    left, bottom = kept.GetImageOrigin()
    address = int(kept.GetImage().split("_")[1], 16)
    buffer = (ctypes.c_uint16 * (buffer_width * buffer_height * 4)).from_address(address)
    rows = numpy.frombuffer(buffer, dtype=numpy.uint16).reshape(buffer_height, buffer_width, 4)
    picture = numpy.zeros((height, width, 4), dtype="<u2")
    picture[bottom : bottom + used_height, left : left + used_width] = rows[:used_height, :used_width]
    picture[::-1].tofile(path)


def timed(work):
    """Milliseconds of processor time (all threads of this process) and of wall time that `work` takes."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return {"cpu_ms": (time.process_time() - cpu) * 1e3, "wall_ms": (time.perf_counter() - wall) * 1e3}


def measure(job, step, window, mapper):
    """One step length: cost and picture."""
    mapper.SetSampleDistance(step["step_world"])
    mapper.SetInteractiveSampleDistance(step["step_world"])
    window.SetSize(*job["image"])
    first = timed(window.Render)
    frames = [timed(window.Render) for _ in range(job["repeats"])]
    casts = [timed(mapper.RenderSubVolume) for _ in range(job["repeats"])]
    used = mapper.GetRayCastImage().GetImageSampleDistance()
    # VTK keeps distances in single precision.
    is_other = abs(mapper.GetSampleDistance() - step["step_world"]) > 1e-6 * step["step_world"]
    if used != 1.0 or is_other:
        raise RuntimeError(f"VTK changed its sampling: {used} pixels, {mapper.GetSampleDistance()} world")
    window.Render()
    write_picture(mapper, step["picture"])
    return {"first": first, "frames": frames, "casts": casts}


def answer_of(job):
    """Versions, and one entry for each step."""
    import numpy
    import vtk

    mapper = ray_caster(job, read_volume(job))
    # Renderer and volume are held until the end: the window does not own what Python made.
    window, renderer, volume = window_of(job, mapper)
    window.SetSize(*job["image"])
    # An empty picture costs what is not ray casting: clearing and reading an OpenGL window.
    volume.VisibilityOff()
    window.Render()
    empty = [timed(window.Render) for _ in range(job["repeats"])]
    volume.VisibilityOn()
    steps = [measure(job, step, window, mapper) for step in job["steps"]]
    return {
        "python": sys.version.split()[0],
        "vtk": vtk.vtkVersion.GetVTKVersion(),
        "numpy": numpy.__version__,
        "window": window.GetClassName(),
        "threads": mapper.GetNumberOfThreads(),
        "empty": empty,
        "steps": steps,
    }


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        job = json.load(file)
    try:
        answer = answer_of(job)
    except Exception as error:  # Whatever stops VTK is an answer, too.
        answer = {"error": f"{type(error).__name__}: {error}"}
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump(answer, file)


if __name__ == "__main__":
    main()
