"""The page in a browser: a model's scene, tracks of episodes, and the pages that show them."""
