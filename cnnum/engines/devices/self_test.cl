// A known answer: whole numbers below 2^24, which every sum, product and floor keeps exactly.
// A vector, a loop, a branch and a local array are what the kernels of plans are made of.
__kernel void self_test(__global const $real *restrict start, __global $real *restrict end,
                        const int rounds)
{
    const size_t item = get_global_id(0);
    $vector state = $load(item, start);
    $vector kept[2] = {state, state};
    for (int round = 0; round < rounds; ++round) {
        const $vector grown = kept[round & 1] * ($real)3 + state + ($real)(round + 1);
        state = grown - floor(grown / ($real)64) * ($real)64;
        if ((round & 3) == 3) { state = fmax(state, kept[0]) + exp(state * ($real)0); }
        kept[round & 1] = state;
    }
    $store(state, item, end);
}
