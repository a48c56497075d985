int row = $rows + stages * $most * 4;
const real begin = R(data[row + 2]);
for (int i = 0; i < $cells; ++i) {
    old[i] = x[i];
    xs[i] = x[i] + begin * h * k0[i];
}
for (int j = 1; j < stages; ++j) {
    row += 4;
    const real back1 = R(data[row]), back2 = R(data[row + 1]);
    const real weight = R(data[row + 2]), start = R(data[row + 3]);
$stage
}
$last_rates
