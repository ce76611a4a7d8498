import gymnasium as gym

import duobench


class StageGain(gym.Wrapper):
    """Pay what each step adds to the stage: an episode that is solved pays 1 in all."""

    def reset(self, **options):
        self.stage = 0.0
        return super().reset(**options)

    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        gain, self.stage = reward - self.stage, reward
        return observation, gain, terminated, truncated, info


env = StageGain(duobench.make("bin_sort", cameras=False, object_state=True))
env.reset(seed=0)
print(sum(env.step(env.action_space.sample())[1] for _ in range(50)))
env.close()
