"""PyTorch's default wheel and images share a process, whichever comes first."""

import pytest

from tests.children import ran
from tests.ecosystem.tools import IMAGES
from tests.envs.tools import TASK

IMAGE = f"""
import duobench
env = duobench.make({TASK!r}, **{IMAGES!r})
image = env.reset(seed=0)[0]["pixels"]["head"]
assert image.std() > 10
"""
PYTORCH = {
    "optimizer": "import torch; torch.optim.Adam([torch.zeros(2, requires_grad=True)])",
    "dynamo": "import torch._dynamo",
    "triton": "import triton",
}
KERNEL = """
import triton
import triton.language as tl

@triton.jit
def double(numbers, count, size: tl.constexpr):
    at = tl.program_id(0) * size + tl.arange(0, size)
    tl.store(numbers + at, 2 * tl.exp(tl.load(numbers + at, mask=at < count)))
"""
COMPILE = """
from kernel import double, triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

types = {"numbers": "*fp32", "count": "i32", "size": "constexpr"}
source = ASTSource(double, signature=types, constexprs={"size": 128})
print(triton.compile(source, target=GPUTarget("cuda", 90, 32)).asm["ptx"][:100])
assert (env.reset(seed=0)[0]["pixels"]["head"] == image).all()
"""


@pytest.mark.parametrize("use", PYTORCH)
@pytest.mark.parametrize("order", ["images first", "images last"])
def test_both_work_in_any_order(order: str, use: str) -> None:
    parts = [IMAGE, PYTORCH[use]]
    done = ran("-c", "\n".join(parts if order == "images first" else parts[::-1]))
    assert done.returncode == 0, done.stderr


def test_a_kernel_is_compiled_after_an_image(tmp_path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    env = {"TRITON_CACHE_DIR": str(tmp_path / "cache")}
    code = f"import os; os.environ.update({env!r})\n{IMAGE}\n{COMPILE}"
    done = ran("-c", code, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert ".version" in done.stdout
