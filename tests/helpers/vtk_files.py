"""Reading files for ParaView as ParaView does."""

import os

import numpy as np
import pytest


def need_vtk():
    """Skip where there is no vtk; the continuous integration must have it."""
    try:
        import vtkmodules.vtkIOHDF  # noqa: F401
    except ImportError:
        if os.environ.get("CI"):
            pytest.fail("no vtk; the tests of files for ParaView must not be skipped here")
        pytest.skip("no vtk is installed (pip install vtk)")


def read_vtkhdf(path):
    """Return the times, and for each the points and point arrays, by name, and vertices.

    VTK does not tell the time of a single frame, which is returned as nan.
    """
    need_vtk()
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    assert reader.CanReadFile(str(path))
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    key = vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    information = reader.GetOutputInformation(0)
    times = [information.Get(key, i) for i in range(information.Length(key))] or [np.nan]
    seen = []
    for time in times:
        reader.UpdateTimeStep(time)
        shown = reader.GetOutput()
        assert shown.GetClassName() == "vtkPolyData"
        assert shown.GetNumberOfCells() == shown.GetNumberOfVerts()
        data, arrays = shown.GetPointData(), {}
        for i in range(data.GetNumberOfArrays()):
            arrays[data.GetArrayName(i)] = np.array(vtk_to_numpy(data.GetArray(i)))
        arrays["points"] = np.array(vtk_to_numpy(shown.GetPoints().GetData()))
        arrays["vertices"] = np.array(vtk_to_numpy(shown.GetVerts().GetConnectivityArray()))
        arrays["ends"] = np.array(vtk_to_numpy(shown.GetVerts().GetOffsetsArray()))
        seen.append(arrays)
    return times, seen


def assert_shows(path, frames):
    """Compare what is read of a file with the frames that it is to show, bit for bit."""
    times, seen = read_vtkhdf(path)
    assert times == frames.times.tolist() or (len(frames.times) == 1 and np.isnan(times[0]))
    of = {
        "points": frames.positions,
        "radius": frames.radii,
        "temperature": frames.temperatures,
        "velocity": frames.velocities,
        "grains": frames.grains,
        "label": frames.labels,
    }
    for f, (count, arrays) in enumerate(zip(frames.particles, seen, strict=True)):
        assert arrays.pop("vertices").tolist() == list(range(count))
        assert arrays.pop("ends").tolist() == list(range(count + 1))
        assert arrays.keys() == of.keys()
        for name, values in of.items():
            wanted = values[f, :count]
            assert (arrays[name].dtype, arrays[name].shape) == (wanted.dtype, wanted.shape), name
            assert arrays[name].tobytes() == wanted.tobytes(), name
