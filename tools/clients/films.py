"""Gymnasium's own films, written by moviepy: of a single environment, of its motion, and of a native batch."""

import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium as gym
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import RecordVideo as RecordVectorVideo
from moviepy import VideoFileClip

from kinreach.envs import RecordMotion

ID = "kinreach:kinreach/UR5SingleStep-v0"


def frames(folder: Path) -> int:
    """Frames of the films in a folder."""
    count = 0
    for file in folder.glob("*.mp4"):
        with VideoFileClip(str(file)) as clip:
            count += clip.n_frames
    return count


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    found = {}
    with TemporaryDirectory() as folder:
        for record, mode in ((RecordVideo, "rgb_array"), (RecordMotion, "rgb_array_list")):
            env = record(gym.make(ID, render_mode=mode), str(place := Path(folder) / mode))
            env.reset(seed=0)
            env.step(env.unwrapped.action_for(env.unwrapped.home + 0.3))
            env.close()
            found[record.__name__] = frames(place)
        batch = gym.make_vec(
            ID.replace("Single", "Multi"), num_envs=4, vectorization_mode="vector_entry_point", render_mode="rgb_array"
        )
        env = RecordVectorVideo(batch, str(place := Path(folder) / "batch"), video_length=20)
        env.reset(seed=0)
        for _ in range(25):
            env.step(env.action_space.sample())
        env.close()
        found["vector RecordVideo"] = frames(place)
    assert found["RecordMotion"] > 10 > found["RecordVideo"] >= 2
    assert found["vector RecordVideo"] >= 20
    print("frames:", ", ".join(f"{name} {count}" for name, count in found.items()))
