#!/usr/bin/python3
"""Bags of ROS 1, written by rosbag with Debian's Python.

    rosbag_write.py FILE [--compression none|bz2|lz4] [--chunk BYTES] [--kinds]              every kind of field, latched topics, odd names
    rosbag_write.py FILE [--compression …]            --images N --width W --height H        a camera
    rosbag_write.py FILE --cut BYTES | --unfinished                                          … cut there, or as a killed recording leaves it

The types demo_msgs/* are in no package: genpy makes their classes from the definitions, which the bag has.
"""
import argparse
import random

import genpy
import genpy.dynamic
import rosbag
from geometry_msgs.msg import TransformStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Empty, Int32, String

HEADER = "\n" + "=" * 80 + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
ALL = """# Every kind of field.
Header header
int32 LIMIT=-7
string GREETING=good day  # to all
bool flag
byte b
char c
int8 i8
uint8 u8
int16 i16
uint16 u16
int32 i32
uint32 u32
int64 i64
uint64 u64
float32 f32
float64 f64
string text
time when
duration span
bool[] flags
uint8[] blob
int16[3] three
float64[] doubles
string[] names
string[2] pair
time[] times
duration[2] spans
demo_msgs/Part part
Part[] parts
Part[2] two
""" + HEADER + "\n" + "=" * 80 + "\nMSG: demo_msgs/Part\nuint8 small\nfloat64 large\nstring name\n"
TRANSFORMS = ("geometry_msgs/TransformStamped[] transforms\n\n" + "=" * 80 + "\nMSG: geometry_msgs/TransformStamped\n"
              + TransformStamped._full_text)
ODD = "float64 xPos\nuint8 K\n"
EPOCH = 1_700_000_000


def types(text, name):
    return {key.split("/")[1]: made for key, made in genpy.dynamic.generate_dynamic(name, text).items()}


def filled(made, at, seed):
    chance = random.Random(seed)
    message = made["All"]()
    message.header.seq = seed
    message.header.stamp = at
    message.header.frame_id = f"frame {seed}"
    message.flag = bool(seed % 2)
    message.b, message.c = -5, 200
    message.i8, message.u8, message.i16, message.u16 = -100, 200, -30000, 60000
    message.i32, message.u32, message.i64, message.u64 = -2**31, 2**32 - 1, -2**63, 2**64 - 1
    message.f32, message.f64 = 0.5, 1 / 3
    message.text = "größe " * (seed % 4)
    message.when, message.span = at, genpy.Duration(-2, 500_000_000)
    message.flags = [bool(chance.getrandbits(1)) for _ in range(seed % 5)]
    message.blob = bytes(chance.getrandbits(8) for _ in range(seed % 9))
    message.three = [1, -2, 3]
    message.doubles = [chance.random() for _ in range(seed % 4)]
    message.names = ["n" * (size % 6) for size in range(seed % 5)]
    message.pair = ["a", "bc"]
    message.times = [at] * (seed % 3)
    message.spans = [genpy.Duration(1, 2), genpy.Duration(-1, 5)]
    part = made["Part"]
    message.part = part(small=1, large=2.5, name="one")
    message.parts = [part(small=size, large=size / 7, name="p" * size) for size in range(seed % 4)]
    message.two = [part(small=8, large=0.125, name=""), part(small=9, large=-1.0, name="zz")]
    return message


def transform(made, at, child):
    one = made["TransformStamped"]()
    one.header.stamp, one.header.frame_id, one.child_frame_id = at, "map", child
    one.transform.rotation.w = 1.0
    return made["TFMessage"]([one])


def write_kinds(bag):
    tf = types(TRANSFORMS, "tf2_msgs/TFMessage")
    made, odd = types(ALL, "demo_msgs/All"), types(ODD, "demo_msgs/odd_type")["odd_type"]

    def latched(topic, message, node):
        at = genpy.Time(EPOCH, 1)
        header = {"callerid": node, "latching": "1", "md5sum": message._md5sum, "type": message._type,
                  "message_definition": message._full_text, "topic": topic}
        bag.write(topic, message, at, connection_header=header)

    latched("/map_name", String("the first floor"), "/map_server")
    latched("/tf_static", transform(tf, genpy.Time(EPOCH, 1), "lidar"), "/lidar_driver")
    latched("/tf_static", transform(tf, genpy.Time(EPOCH, 1), "camera"), "/camera_driver")
    for count in range(40):
        at = genpy.Time(EPOCH + count // 10, 1000 + count % 10 * 100_000_000)
        bag.write("/all", filled(made, at, count), at)
        bag.write("/robot-1/1st", Int32(count), at)
        bag.write("odd/names", odd(xPos=count / 4, K=count), at)
        bag.write("/clock", Clock(at), at)
        bag.write("/empty", Empty(), at)
        bag.write("/tf", transform(tf, at, "base"), at)
        image = Image(height=8, width=6, encoding="mono8", step=6, data=bytes(range(48)))
        image.header.stamp, image.header.seq = at, count
        bag.write("/camera/image_raw", image, at)
        info = CameraInfo(height=8, width=6, distortion_model="plumb_bob", D=[0.1, 0.2], K=[float(k) for k in range(9)])
        bag.write("/camera/camera_info", info, at)


def write_images(bag, count, width, height):
    row = random.Random(1).randbytes(width * height * 3)
    for number in range(count):
        at = genpy.Time(EPOCH + number // 30, number % 30 * 33_000_000 + 1)
        shift = number % 97
        image = Image(height=height, width=width, encoding="bgr8", step=width * 3, data=row[shift:] + row[:shift])
        image.header.stamp, image.header.seq = at, number
        bag.write("/camera/image_raw", image, at)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("file")
    parser.add_argument("--compression", default="none")
    parser.add_argument("--chunk", type=int, default=8192)
    parser.add_argument("--images", type=int)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--height", type=int, default=480)
    parser.add_argument("--cut", type=int, help="bytes that are left")
    parser.add_argument("--unfinished", action="store_true")
    args = parser.parse_args()
    bag = rosbag.Bag(args.file, "w", compression=args.compression, chunk_threshold=args.chunk)
    write_images(bag, args.images, args.width, args.height) if args.images else write_kinds(bag)
    count = sum(len(index) for index in bag._connection_indexes.values())
    if args.unfinished:
        bag._file.flush()
        bag._file.close()
    else:
        bag.close()
    if args.cut:
        with open(args.file, "r+b") as file:
            file.truncate(args.cut)
    print(count)


main()
