$note
__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void $kernel(__global const scalar *restrict input, __global scalar *restrict output,
          __global scalar *restrict memory, __global const scalar *restrict data,
          __global scalar *restrict scratch, __global scalar *restrict registers,
          __global scalar *restrict partials, const int batch, const int is_first)
{
    const int piece = (int)get_global_id(0), frame = (int)get_global_id(1);
    const int last = batch - 1;
    __global scalar *const mine = scratch + (size_t)frame * FRAME_SIZE;
$body
}
