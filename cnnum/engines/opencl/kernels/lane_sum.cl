for (int n = 0; n < $length; n += $width) {
    const int at = min(n, $last);
    vec a[$width];
    for (int k = 0; k < $width; ++k) {
        const int p = ROW(own) + min(at + k, $length - 1) * $width;
        vec $sum = (vec)(0);
$lines
        a[k] = $sum;
    }
    keep_cells($to, a, at);
}
