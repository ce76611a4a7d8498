"""Tiny checkpoints with random weights, saved by LeRobot itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.policies import get_policy_class, make_policy_config, make_pre_post_processors
from numpy.typing import NDArray

CAMERAS = ("head", "left_wrist")
SIZE = 64
"""Side of an image; four halvings of a ResNet leave 2 x 2 features."""
WORDS = ("Put", "the", "cube", "into", "bowl", "and")


def features(
    cameras: tuple[str, ...] = CAMERAS, size: int = SIZE, width: int = 16
) -> dict[str, Any]:
    """What a policy sees and controls, in the shapes of this benchmark unless told otherwise."""
    images = {
        f"observation.images.{camera}": PolicyFeature(FeatureType.VISUAL, (3, size, size))
        for camera in cameras
    }
    return {
        "input_features": {
            "observation.state": PolicyFeature(FeatureType.STATE, (width,)),
            **images,
        },
        "output_features": {"action": PolicyFeature(FeatureType.ACTION, (width,))},
        "device": "cpu",
        "push_to_hub": False,
    }


def save(
    folder: Path,
    kind: str,
    *,
    known: dict[str, dict[str, torch.Tensor]] | None = None,
    **options: Any,
) -> Path:
    """Save a policy with random weights, and its processors.

    Args:
        folder: Where.
        kind: LeRobot's name of the kind of policy.
        known: Statistics of features that are not to be made up.
        options: Fields of its configuration.
    """
    torch.manual_seed(1)
    config = make_policy_config(kind, **{**features(), **options})
    get_policy_class(kind)(config).save_pretrained(folder)
    keys = [*config.input_features, *config.output_features]
    stats = {key: statistics(config, key) for key in keys} | (known or {})
    for processor in make_pre_post_processors(config, dataset_stats=stats):
        processor.save_pretrained(folder)
    return folder


def statistics(config: Any, key: str) -> dict[str, torch.Tensor]:
    """Statistics under which normal noise becomes small motions about the middle of the ranges."""
    shape = {**config.input_features, **config.output_features}[key].shape
    size = (shape[0], 1, 1) if len(shape) == 3 else shape
    generator = torch.Generator().manual_seed(len(key))
    middle = 0.1 * torch.randn(size, generator=generator)
    spread = torch.full(size, 0.05)
    low, high = middle - spread, middle + spread
    return {"mean": middle, "std": spread, "min": low, "max": high, "q01": low, "q99": high}


def act(folder: Path, **options: Any) -> Path:
    """ACT with 30 actions."""
    small = {
        "dim_model": 32,
        "n_heads": 2,
        "dim_feedforward": 32,
        "n_encoder_layers": 1,
        "n_vae_encoder_layers": 1,
        "latent_dim": 4,
        "pretrained_backbone_weights": None,
        "chunk_size": 30,
        "n_action_steps": 30,
    }
    return save(folder, "act", **{**small, **options})


AUTHORS_CAMERAS = ("head", "left_wrist", "right_wrist")


def act_as_the_authors(folder: Path, action: NDArray[np.floating], spread: float = 1e-3) -> Path:
    """A small ACT in the form of the authors' published checkpoints.

    That is chunks of 100, the keys of their data set in its order, images of 224 x 224, and vectors
    of seven joints and a gripper that is 0 or 1, of the left arm and then of the right.

    Args:
        folder: Where.
        action: What it always does (16,), but for `spread`.
        spread: Standard deviation of the numbers of its actions.
    """
    middle = torch.from_numpy(action.astype(np.float32))
    stats = {"mean": middle, "std": torch.full_like(middle, spread)}
    seen = features(AUTHORS_CAMERAS, size=224)
    state, *images = seen["input_features"].items()
    seen["input_features"] = dict([*images, state])
    return act(folder, chunk_size=100, n_action_steps=100, known={"action": stats}, **seen)


def diffusion(folder: Path, **options: Any) -> Path:
    """A diffusion policy that sees two observations and predicts 16 actions, by DDPM."""
    small = {
        "down_dims": (16, 32),
        "diffusion_step_embed_dim": 16,
        "n_groups": 4,
        "num_train_timesteps": 4,
        "spatial_softmax_num_keypoints": 4,
        "pretrained_backbone_weights": None,
        "crop_ratio": 1.0,
        "horizon": 16,
        "n_action_steps": 8,
    }
    return save(folder, "diffusion", **{**small, **options})


def tokenizer(folder: Path) -> Path:
    """A tokenizer of a few words."""
    from tokenizers import Tokenizer, models, pre_tokenizers
    from transformers import PreTrainedTokenizerFast

    words = ["<pad>", "<s>", "</s>", "<unk>", *WORDS]
    vocabulary = {word: number for number, word in enumerate(words)}
    model = Tokenizer(models.WordLevel(vocabulary, unk_token="<unk>"))
    model.pre_tokenizer = pre_tokenizers.Whitespace()
    PreTrainedTokenizerFast(
        tokenizer_object=model,
        pad_token="<pad>",
        bos_token="<s>",
        eos_token="</s>",
        unk_token="<unk>",
    ).save_pretrained(folder)
    return folder


def _vision_language_model(folder: Path) -> Path:
    """A model of the kind that SmolVLA is built on: configuration and processors, no weights."""
    from transformers import (
        PreTrainedTokenizerFast,
        SmolVLMConfig,
        SmolVLMImageProcessor,
        SmolVLMProcessor,
        SmolVLMVideoProcessor,
    )

    special = {
        "fake_image_token": "<fake>",
        "image_token": "<image>",
        "global_image_token": "<global>",
        "end_of_utterance_token": "<end>",
    }
    words = PreTrainedTokenizerFast.from_pretrained(tokenizer(folder), extra_special_tokens=special)
    text = {
        "model_type": "llama",
        "hidden_size": 32,
        "intermediate_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 4,
        "num_key_value_heads": 2,
        "head_dim": 8,
        "vocab_size": 32,
        "pad_token_id": 0,
    }
    vision = {
        "hidden_size": 16,
        "intermediate_size": 16,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "image_size": SIZE,
        "patch_size": 16,
    }
    SmolVLMConfig(
        text_config=text,
        vision_config=vision,
        scale_factor=2,
        image_token_id=words.convert_tokens_to_ids("<image>"),
    ).save_pretrained(folder)
    parts = SmolVLMImageProcessor(), words, SmolVLMVideoProcessor()
    SmolVLMProcessor(*parts, image_seq_len=4).save_pretrained(folder)
    return folder


def smolvla(folder: Path, **options: Any) -> Path:
    """SmolVLA with two layers."""
    small = {
        "vlm_model_name": str(_vision_language_model(folder.with_name(f"{folder.name}-base"))),
        "num_vlm_layers": 2,
        "num_steps": 2,
        "resize_imgs_with_padding": (SIZE, SIZE),
        "tokenizer_max_length": 8,
    }
    return save(folder, "smolvla", **{**small, **options})


def xvla(folder: Path, **options: Any) -> Path:
    """X-VLA with 16 of 20 action numbers used."""
    stages = 2
    florence = {
        "vision_config": {
            "depths": [1] * stages,
            "embed_dim": [16] * stages,
            "num_heads": [2] * stages,
            "num_groups": [2] * stages,
            "patch_size": [7, 3],
            "patch_stride": [4, 2],
            "patch_padding": [3, 1],
            "patch_prenorm": [False, True],
            "projection_dim": 16,
            "window_size": 4,
        },
        "text_config": {
            "model_type": "bart",
            "vocab_size": 32,
            "d_model": 16,
            "encoder_layers": 1,
            "decoder_layers": 1,
            "encoder_attention_heads": 2,
            "decoder_attention_heads": 2,
            "encoder_ffn_dim": 16,
            "decoder_ffn_dim": 16,
        },
        "projection_dim": 16,
    }
    small = {
        "florence_config": florence,
        "tokenizer_name": str(tokenizer(folder.with_name(f"{folder.name}-tokenizer"))),
        "tokenizer_max_length": 16,
        "hidden_size": 16,
        "depth": 1,
        "num_heads": 2,
        "num_domains": 2,
        "len_soft_prompts": 2,
        "action_mode": "auto",
        "num_denoising_steps": 2,
        "num_image_views": 2,
    }
    return save(folder, "xvla", **{**small, **options})


def _qwen(folder: Path, backbone: Path) -> Path:
    """A tiny model of the kind that GR00T is built on: its words in `folder`, its configuration."""
    from transformers import (
        PreTrainedTokenizerFast,
        Qwen2VLImageProcessor,
        Qwen3VLConfig,
        Qwen3VLVideoProcessor,
    )

    special = {
        "image_token": "<|image_pad|>",
        "video_token": "<|video_pad|>",
        "vision_bos_token": "<|vision_start|>",
        "vision_eos_token": "<|vision_end|>",
    }
    words = PreTrainedTokenizerFast.from_pretrained(tokenizer(folder), extra_special_tokens=special)
    words.chat_template = (
        "{% for message in messages %}{% for part in message['content'] %}"
        "{% if part['type'] == 'image' %}<|vision_start|><|image_pad|><|vision_end|>"
        "{% else %}{{ part['text'] }}{% endif %}{% endfor %}{% endfor %}"
    )
    words.save_pretrained(folder)
    sizes = {"min_pixels": 32 * 32, "max_pixels": SIZE * SIZE}
    Qwen2VLImageProcessor(patch_size=16, merge_size=2, **sizes).save_pretrained(folder)
    Qwen3VLVideoProcessor().save_pretrained(folder)
    ids = {
        name: words.convert_tokens_to_ids(special[token])
        for name, token in {
            "image_token_id": "image_token",
            "video_token_id": "video_token",
            "vision_start_token_id": "vision_bos_token",
            "vision_end_token_id": "vision_eos_token",
        }.items()
    }
    text = {
        "hidden_size": 16,
        "intermediate_size": 16,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "num_key_value_heads": 1,
        "head_dim": 8,
        "vocab_size": 32,
        "pad_token_id": 0,
        "rope_scaling": {
            "mrope_interleaved": True,
            "mrope_section": [2, 1, 1],
            "rope_type": "default",
        },
    }
    vision = {
        "depth": 1,
        "hidden_size": 16,
        "intermediate_size": 16,
        "num_heads": 2,
        "num_position_embeddings": 64,
        "out_hidden_size": 16,
        "patch_size": 16,
        "deepstack_visual_indexes": [0],
    }
    Qwen3VLConfig(
        **ids, text_config=text, vision_config=vision, tie_word_embeddings=True
    ).save_pretrained(backbone)
    return backbone


def groot_base(folder: Path) -> Path:
    """A tiny GR00T N1.7 as NVIDIA publishes it, no policy of LeRobot yet.

    The name of its tokenizer, fixed in LeRobot's code, is a path relative to the working directory.
    """
    from lerobot.policies.groot.groot_n1_7 import GR00TN17, GR00TN17Config

    torch.manual_seed(1)
    words = Path("nvidia/Cosmos-Reason2-2B")
    backbone = _qwen(words, folder.with_name(f"{folder.name}-backbone"))
    layers = {"positional_embeddings": None, "num_attention_heads": 2, "attention_head_dim": 8}
    config = GR00TN17Config(
        model_name=str(backbone),
        backbone_embedding_dim=16,
        select_layer=1,
        hidden_size=16,
        input_embedding_dim=16,
        num_inference_timesteps=2,
        vl_self_attention_cfg={**layers, "num_layers": 1, "dropout": 0.0},
        diffusion_model_cfg={
            **layers,
            "num_layers": 2,
            "norm_type": "ada_norm",
            "output_dim": 16,
            "interleave_self_attention": True,
        },
    )
    GR00TN17(config, load_backbone_weights=False).save_pretrained(folder)
    return folder


def groot(folder: Path, **options: Any) -> Path:
    """GR00T N1.7 with one layer, fine-tuned as LeRobot saves it."""
    base = groot_base(folder.with_name(f"{folder.name}-base"))
    return save(folder, "groot", **{"base_model_path": str(base), "use_bf16": False, **options})


def change(folder: Path, name: str, **values: Any) -> None:
    """Change values of one of the JSON files of a checkpoint."""
    path = folder / name
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def pi05(folder: Path, **options: Any) -> Path:
    """π0.5, which `shrink_pi05` makes small."""
    small = {"chunk_size": 30, "n_action_steps": 30, "num_inference_steps": 2, "dtype": "float32"}
    sizes = {"tokenizer_max_length": 16, "image_resolution": (SIZE, SIZE)}
    return save(folder, "pi05", **{**small, **sizes, **options})


def shrink_pi05(patch: Any, folder: Path) -> None:
    """Make π0.5 small, whose sizes are fixed in LeRobot's code, and find its words.

    Args:
        patch: pytest's `MonkeyPatch`.
        folder: Becomes the working directory: the name of the tokenizer is also a relative path.
    """
    from lerobot.policies.pi05 import modeling_pi05 as code

    width = 16
    sizes = code.GemmaConfig(
        width=width, depth=1, mlp_dim=16, num_heads=8, num_kv_heads=1, head_dim=8
    )
    model = code.PaliGemmaForConditionalGenerationWithPiGemma

    def small(config: Any) -> Any:
        config.text_config.vocab_size = 1024
        config.projection_dim = width
        for name, value in {
            "hidden_size": 16,
            "intermediate_size": 16,
            "num_hidden_layers": 1,
            "num_attention_heads": 2,
            "patch_size": 16,
            "projection_dim": width,
        }.items():
            setattr(config.vision_config, name, value)
        return model(config=config)

    patch.setattr(code, "get_gemma_config", lambda _variant: sizes)
    patch.setattr(code, "PaliGemmaForConditionalGenerationWithPiGemma", small)
    tokenizer(folder / "google/paligemma-3b-pt-224")
    patch.chdir(folder)
