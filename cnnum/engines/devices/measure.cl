// Figures of a device: how fast it multiplies and adds, and how fast it moves numbers.
// Each chain waits for itself only, so that several of them hide the latency of one operation;
// their sum is stored, so that none can be dropped.
__kernel void arithmetic(__global const $vector *restrict start,
                         __global $vector *restrict end,
                         const int rounds)
{
    const size_t item = get_global_id(0);
    const $vector factor = start[0];
    const $vector term = start[1];
$begin
    for (int round = 0; round < rounds; ++round) {
$step
    }
    end[item] = $sum;
}

__kernel void copy(__global const $vector *restrict from, __global $vector *restrict to)
{
    const size_t item = get_global_id(0);
    to[item] = from[item];
}
