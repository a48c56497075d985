// The read-out "$read_out" of $count numbers in chains of every ${chains}th of them, and then one half of
// the chains with the other. Written into every loop that it follows it takes twice as long to build.
static __attribute__((noinline)) real ${function}(__private const real *numbers)
{
    $body
}
