        // $method: $count steps of $step, the array in registers, a row a vector
$begin
        for (int n = 0; n < $count; ++n) {
$step_text
        }
$end
