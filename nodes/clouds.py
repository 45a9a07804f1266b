"""A NumPy array of records as sensor_msgs/PointCloud2."""

from array import array
from collections.abc import Collection
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

_KINDS = {
    "<f4": PointField.FLOAT32,
    "<f8": PointField.FLOAT64,
    "<u4": PointField.UINT32,
    "<i4": PointField.INT32,
    "|u1": PointField.UINT8,
}


def point_cloud(header: Any, rows: "np.ndarray[Any, Any]", packed: Collection[str] = ()) -> PointCloud2:
    """One point per record.

    Args:
        header: of the message.
        rows: (N,) records of little-endian numbers; its fields are those of the cloud.
        packed: fields of 32 bits that are announced as FLOAT32, as RViz expects of rgb.
    """
    names = rows.dtype.names or ()
    size = rows.dtype.itemsize
    cloud = PointCloud2(header=header, height=1, width=len(rows), point_step=size, row_step=size * len(rows))
    cloud.fields = [
        PointField(
            name=name,
            offset=rows.dtype.fields[name][1],
            datatype=PointField.FLOAT32 if name in packed else _KINDS[rows.dtype[name].str],
            count=1,
        )
        for name in names
    ]
    cloud.is_dense = True
    cloud.data = array("B", rows.tobytes())
    return cloud
