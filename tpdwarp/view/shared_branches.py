"""Faint branches that samples of a pixel share: one follows them for several.

Let light vary by σ within a pixel of n samples. Its mean then has variance σ²/n; a branch that carries a part t of each
sample, and that m samples follow, adds t²σ²/m. So few follow it, each for n/m of them, and the mean is what it was.
"""

import warp as wp

# What a sample carries of a branch for others of its pixel, too, at most. Chosen by measurement: tumbler and table err
# 4 % and 3 % more than where all samples follow all branches, in two thirds of the time; at .19, 12 % and 7 % more.
MOST_FOR_OTHERS = 0.1
# Random numbers that choose the sample are others than those that choose places on the lens and on lights.
OF_BRANCHES = wp.constant(15485863)


@wp.func
def samples_served(throughput: wp.vec3, samples: int, most_for_others: float) -> int:
    """For how many samples of a pixel one of them follows a branch: a power of two that divides ``samples``.

    Args:
        throughput: What the branch carries of a sample.
        samples: Samples a pixel.
        most_for_others: What one carries of it for others, too, at most.
    """
    served = int(1)
    while samples % (2 * served) == 0 and wp.max(throughput) * float(2 * served) <= most_for_others:
        served *= 2
    return served


@wp.func
def follows(film: wp.vec2, sample: int, mask: int, served: int) -> bool:
    """Whether a sample of the pixel at ``film`` is the one of ``served`` that follows the branch named by ``mask``.

    It is another one in each pixel and for each branch, and the same in every frame. Those that follow are chosen from
    all parts of the pixel (:func:`~tpdwarp.view.sampling.film_positions`), where every fourth or sixteenth lies in one.
    """
    if served == 1:
        return True
    chance = wp.rand_init(int(OF_BRANCHES) + mask, int(wp.floor(film[0])) * 65537 + int(wp.floor(film[1])))
    block = sample // served
    chosen = int(wp.randf(chance) * float(served)) + 5 * block + block * served // 16
    return sample % served == chosen % served
