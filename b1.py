import gymnasium as gym
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import SubprocVecEnv

import duobench


def made():
    env = duobench.make(
        "bin_sort", cameras=False, object_state=True, action_mode="joint_relative", split="train"
    )
    return gym.wrappers.RescaleAction(env, -1.0, 1.0)


if __name__ == "__main__":
    envs = SubprocVecEnv([made] * 2, start_method="spawn")
    model = PPO("MultiInputPolicy", envs, n_steps=32, batch_size=16, seed=0, device="cpu")
    model.learn(64)
    model.save("ppo")
    envs.close()
