"""Stand-ins for the messages of sensor_msgs that are used."""

from geometry_msgs.msg import Header, Message


class PointField(Message, name="", offset=0, datatype=0, count=0):
    FLOAT32 = 7


class PointCloud2(
    Message,
    header=Header,
    height=0,
    width=0,
    fields=list,
    is_bigendian=False,
    point_step=0,
    row_step=0,
    data=bytes,
    is_dense=False,
):
    pass
