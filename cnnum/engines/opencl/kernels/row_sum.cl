for (int n = 0; n < $length; n += $width) {
    const int p = (own + $radius) * $pitch + $head + n;
    vec $sum = (vec)(0);
$lines
    *($space vec *)($to + n) = $sum;
}
