#!/usr/bin/env python3
"""Decodes every golden vector with nothing but the tables of wire.md, and compares it with its JSON.

It needs Python 3.9 and no packages, and is the shortest example of a holocast/1 decoder in another language.
"""

import json
import pathlib
import struct
import sys


class Reader:
    """Takes values off the front of some bytes (wire.md, section 4)."""

    def __init__(self, data):
        self.data = data
        self.at = 0

    def take(self, count):
        if count > len(self.data) - self.at:
            raise ValueError(f"ends at byte {len(self.data)}, expected {count} more at {self.at}")
        self.at += count
        return self.data[self.at - count : self.at]

    def number(self, form):
        return struct.unpack("<" + form, self.take(struct.calcsize(form)))[0]

    def u8(self):
        return self.number("B")

    def u16(self):
        return self.number("H")

    def u32(self):
        return self.number("I")

    def u64(self):
        return self.number("Q")

    def i64(self):
        return self.number("q")

    def f32(self):
        return self.number("f")

    def bool(self):
        value = self.u8()
        if value > 1:
            raise ValueError(f"truth value {value}")
        return bool(value)

    def string(self):
        return self.take(self.u64()).decode("utf-8")

    def option(self, read):
        return read() if self.bool() else None

    def array(self, count, read):
        return [read() for _ in range(count)]

    def fields(self, **readers):
        return {name: read() for name, read in readers.items()}

    # Section 5
    def pose(self):
        return self.fields(
            position_m=lambda: self.array(3, self.f32), orientation_xyzw=lambda: self.array(4, self.f32)
        )

    def fov(self):
        return self.fields(left_rad=self.f32, right_rad=self.f32, up_rad=self.f32, down_rad=self.f32)

    def quality(self):
        return self.fields(resolution_scale=self.f32, step_scale=self.f32, shading=self.u8)

    def goodbye(self):
        return self.fields(code=lambda: CLOSE_CODES[self.u32()], reason=self.string)

    # Section 6
    def client_message(self):
        return self.variant(
            Hello=lambda: self.fields(version=self.u16, pairing_code=self.string, device=self.device),
            ChangeScene=lambda: self.fields(request_id=self.u32, scene_json=self.string),
            Statistics=lambda: self.fields(
                frames_received=self.u64,
                frames_decoded=self.u64,
                frames_lost=self.u64,
                frames_stale=self.u64,
                frames_late=self.u64,
                decode_ms_mean=self.f32,
                pose_to_decoded_ms_mean=self.f32,
                pose_to_decoded_ms_max=self.f32,
                motion_to_photon_ms_mean=self.f32,
                round_trip_ms=self.f32,
            ),
            Goodbye=self.goodbye,
        )

    def device(self):
        return self.fields(
            name=self.string,
            eye_width_px=self.u32,
            eye_height_px=self.u32,
            refresh_hz=self.f32,
            eyes=lambda: self.array(2, lambda: self.fields(head_from_eye=self.pose, fov=self.fov)),
            max_bitrate_bps=self.u32,
        )

    def server_message(self):
        return self.variant(
            Welcome=lambda: self.fields(
                version=self.u16,
                session_id=self.u64,
                stream=lambda: self.fields(
                    width_px=self.u32,
                    height_px=self.u32,
                    refresh_hz=self.f32,
                    bitrate_bps=self.u32,
                    codec=self.string,
                ),
                server_name=self.string,
                scene_revision=self.u32,
            ),
            SceneChanged=lambda: self.fields(
                request_id=lambda: self.option(self.u32),
                revision=self.u32,
                scene_json=lambda: self.option(self.string),
            ),
            SceneRefused=lambda: self.fields(request_id=self.u32, reason=self.string),
            Statistics=lambda: self.fields(
                frames_rendered=self.u64,
                frames_sent=self.u64,
                frames_reset=self.u64,
                frames_skipped=self.u64,
                quality=self.quality,
                bitrate_bps=self.u32,
            ),
            Goodbye=self.goodbye,
        )

    # Section 7
    def client_datagram(self):
        return self.variant(
            Pose=lambda: self.fields(
                sequence=self.u64, sampled_at_us=self.u64, display_at_us=self.u64, world_from_head=self.pose
            ),
            Ping=lambda: self.fields(
                sequence=self.u64,
                sent_at_us=self.u64,
                clock=lambda: self.option(
                    lambda: self.fields(server_minus_headset_us=self.i64, round_trip_us=self.u32)
                ),
            ),
            Feedback=lambda: self.fields(
                sequence=self.u64,
                newest_completed=lambda: self.option(self.u64),
                completed_before=self.u64,
                newest_decoded=lambda: self.option(self.u64),
                key_frame_needed=self.bool,
            ),
        )

    def server_datagram(self):
        return self.variant(
            Pong=lambda: self.fields(
                sequence=self.u64, ping_sent_at_us=self.u64, received_at_us=self.u64, sent_at_us=self.u64
            )
        )

    # Section 8
    def frame_header(self):
        stages = "pose_received render_started rendered converted encode_started encoded sent".split()
        return self.fields(
            frame=self.u64,
            depends_on=lambda: self.option(self.u64),
            scene_revision=self.u32,
            time_step=self.u32,
            pose_sequence=self.u64,
            pose_sampled_at_us=self.u64,
            display_at_us=self.u64,
            eyes=lambda: self.array(2, lambda: self.fields(world_from_eye=self.pose, fov=self.fov)),
            stages=lambda: self.fields(**{f"{stage}_us": self.u64 for stage in stages}),
            quality=self.quality,
            depth=lambda: self.fields(
                columns=self.u16, rows=self.u16, distances_mm=lambda: self.array(self.u64(), self.u16)
            ),
            access_unit_bytes=self.u32,
        )

    def variant(self, **variants):
        name, read = list(variants.items())[self.u32()]
        return {name: read()}

    def all_of(self, read):
        value = read()
        if self.at != len(self.data):
            raise ValueError(f"complete after {self.at} bytes, found {len(self.data)}")
        return value


CLOSE_CODES = (
    "Goodbye ShuttingDown BadVersion BadMessage BadDevice NotPaired TooManyHeadsets Stalled Idle Internal".split()
)


def behind_length(data):
    """A control message's body: all that follows the u32 length."""
    (length,) = struct.unpack("<I", data[:4])
    if length != len(data) - 4:
        raise ValueError(f"states {length} bytes, found {len(data) - 4}")
    return Reader(data[4:])


def frame(data):
    (length,) = struct.unpack("<I", data[:4])
    reader = Reader(data[4 : 4 + length])
    header, access_unit = reader.all_of(reader.frame_header), data[4 + length :]
    depth = header["depth"]
    if len(depth["distances_mm"]) != 2 * depth["columns"] * depth["rows"]:
        raise ValueError("depth grid is not filled")
    if header["access_unit_bytes"] != len(access_unit):
        raise ValueError(f"states {header['access_unit_bytes']} bytes, found {len(access_unit)}")
    return {"header": header, "access_unit": list(access_unit)}


def decoded(kind, data):
    if kind == "frame":
        return frame(data)
    reader = behind_length(data) if kind.endswith("_message") else Reader(data)
    return reader.all_of(getattr(reader, kind))


def main():
    folder = pathlib.Path(__file__).parent / "vectors"
    failures = 0
    descriptions = sorted(folder.glob("*.json"))
    for description in descriptions:
        expected = json.loads(description.read_text(encoding="utf-8"))
        size = expected.pop("bytes")
        ((kind, value),) = expected.items()
        data = description.with_suffix(".bin").read_bytes()
        try:
            found = decoded(kind, data)
            is_right = found == value and len(data) == size
        except (ValueError, IndexError, struct.error) as error:
            found, is_right = error, False
        if not is_right:
            failures += 1
            print(f"{description.stem}: expected {value}\n{description.stem}: found    {found}")
    print(f"{len(descriptions)} vectors, {failures} wrong")
    return 1 if failures or not descriptions else 0


if __name__ == "__main__":
    sys.exit(main())
