        // $method: steps follow the error estimate
        real time = ZERO, steps = ZERO, settled = ZERO, error = ZERO, h = $first_step;
        real running = PICK(time < $duration, ONE, ZERO);
$first_rates
        for (int n = 0; n < $limit && ANY_LANE(running); ++n) {
            real worst = ZERO, local_error = ZERO, change = ZERO;
            h = fmin(fmin(h, $longest), $duration - time);
$stages
$judge
            const real accept = PICK(worst <= ONE, running, ZERO);
$advance
            time += accept * h;
            steps += running;
            error += accept * local_error;
            settled = PICK(accept * $settle != ZERO && change <= ONE, ONE, settled);
            running = PICK(time >= $duration * $almost_one || settled != ZERO, ZERO, running);
            h = PICK(running != ZERO,
                     h * clamp(R(0.9) * pow(fmax(worst, R(1e-10)), $exponent), R(0.2), R(5)), h);
        }
        unfinished = fmax(unfinished, running);
