$tables

// One work item runs the whole program for LANES frames.
__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void plan(__global const scalar *restrict input, __global scalar *restrict output,
          __global scalar *restrict memory, __global const scalar *restrict data,
          __global real *restrict scratch, const int batch, const int is_first)
{
    const int frame = (int)get_global_id(0) * LANES;
    const int last = batch - 1;
    const real first = R(is_first);
    real unfinished = ZERO;
$body
}
