#ifdef cl_khr_fp64
// Takes numbers as the host has them. Each is looked at on its way: bits of numbers that
// are not negative are ordered as these are. Infinity comes after all of them, then NaN.
__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void take_$given(__global const $given *restrict given, const long apart, const long count,
                 __global scalar *restrict input, const long size, const long at,
                 __global scalar *restrict seen)
{
    const int piece = (int)get_global_id(0), pieces = (int)get_global_size(0);
    const int frame = (int)get_global_id(1);
    const long begin = count * piece / pieces, end = count * (piece + 1) / pieces;
    $bits most = 0;
    for (long i = begin; i < end; ++i) {
        const scalar value = (scalar)given[frame * apart + i];
        const $bits bits = as_$bits(value) & $mask;
        most = most < bits ? bits : most;
        input[frame * size + at + i] = value;
    }
    seen[frame * pieces + piece] += most < $infinite ? 0 : 1;
}
#endif
