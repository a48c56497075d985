$near
$arrays
const int top = r * $block, high = min($block, $rows - top);
for (int own = -$radius; own < high + $radius; ++own) {
    const int at_row = top + own;
    $seen
}
for (int own = 0; own < high; ++own) {
    $sums
#pragma clang loop vectorize(assume_safety)
    for (int c = 0; c < $cols; ++c) {
        const int i = (top + own) * $cols + c;
        $body
    }
}
