        // runge-kutta-chebyshev: steps follow the error estimate, stages follow the steps
        real time = ZERO, steps = ZERO, settled = ZERO, error = ZERO, h = $first_step;
        real speed_before = ZERO;
        real running = PICK(time < $duration, ONE, ZERO);
$first_rates
        for (int i = 0; i < $cells; ++i) {
            speed_before = greater(speed_before, fabs(k0[i]));
        }
        for (int n = 0; n < $limit && ANY_LANE(running); ++n) {
            real worst = ZERO, added = ZERO, speed = ZERO, change = ZERO;
            h = fmin(h, fmin($longest, $duration - time));
            // the lane with the longest step says how many stages all of them take
            const scalar reach = LARGEST_LANE(running * h * $fastest * $reach) + (scalar)1;
            int stages = 2;
            while (stages < $most && (scalar)(stages * stages) < reach) {
                ++stages;
            }
$stages
$judge
            const real accept = PICK(worst <= ONE, running, ZERO);
$advance
            time += accept * h;
            steps += running;
            // an error grows as the rates do, within what the feedback allows
            const real faster = fmax(speed / fmax(speed_before, $smallest_rate), ONE);
            const real grown = fmin(faster, exp(fmin($growth * h, $largest_exponent)));
            error = PICK(accept != ZERO, fmin(error * grown + added, $lost), error);
            speed_before = PICK(accept != ZERO, speed, speed_before);
            settled = PICK(accept * $settle != ZERO && change <= ONE, ONE, settled);
            running = PICK(time >= $duration * $almost_one || settled != ZERO, ZERO, running);
            h = PICK(running != ZERO,
                     h * clamp(R(0.8) * pow(fmax(worst, R(1e-10)), $exponent), R(0.1), R(5)), h);
        }
        unfinished = fmax(unfinished, running);
