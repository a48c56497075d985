#ifdef cl_khr_fp64
// Gives results as doubles; each is looked at as in what is taken.
__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void give(__global const scalar *restrict output, const long size, const long at,
          __global double *restrict result, const long count, __global scalar *restrict seen)
{
    const int piece = (int)get_global_id(0), pieces = (int)get_global_size(0);
    const int frame = (int)get_global_id(1);
    const long begin = count * piece / pieces, end = count * (piece + 1) / pieces;
    $bits most = 0;
    for (long i = begin; i < end; ++i) {
        const scalar value = output[frame * size + at + i];
        const $bits bits = as_$bits(value) & $mask;
        most = most < bits ? bits : most;
        result[frame * count + i] = value;
    }
    seen[frame * pieces + piece] += most < $infinite ? 0 : 1;
}
#endif
