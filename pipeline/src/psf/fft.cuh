// Complex numbers and short discrete Fourier transforms in the registers of one thread, for transform.cuh.

#pragma once

#define DEVICE __device__ __forceinline__

// Complex arithmetic. INVERSE conjugates the roots of unity.

struct Complex { float re, im; };
DEVICE Complex complex(float re, float im) { Complex c; c.re = re; c.im = im; return c; }
DEVICE Complex operator+(Complex a, Complex b) { return complex(a.re + b.re, a.im + b.im); }
DEVICE Complex operator-(Complex a, Complex b) { return complex(a.re - b.re, a.im - b.im); }
DEVICE Complex times(Complex a, Complex b) { return complex(fmaf(a.re, b.re, -(a.im * b.im)), fmaf(a.re, b.im, a.im * b.re)); }
DEVICE Complex times_conjugate(Complex a, Complex b) { return complex(fmaf(a.re, b.re, a.im * b.im), fmaf(a.im, b.re, -(a.re * b.im))); }
template <bool INVERSE> DEVICE Complex times_root(Complex a, float cos, float sin) {
    return INVERSE ? times(a, complex(cos, sin)) : times(a, complex(cos, -sin));
}
template <bool INVERSE> DEVICE Complex times_i(Complex a) { return INVERSE ? complex(-a.im, a.re) : complex(a.im, -a.re); }
template <bool INVERSE> DEVICE Complex times_eighth_root(Complex a) { // times exp(-+ i pi / 4)
    const float h = 0.707106781186547524f;
    return INVERSE ? complex(h * (a.re - a.im), h * (a.re + a.im)) : complex(h * (a.re + a.im), h * (a.im - a.re));
}

template <bool INVERSE> DEVICE void fft4(Complex &a, Complex &b, Complex &c, Complex &d) {
    const Complex s = a + c, t = a - c, u = b + d, v = times_i<INVERSE>(b - d);
    a = s + u;
    b = t + v;
    c = s - u;
    d = t - v;
}

// In place, outputs in order.
template <int N, bool INVERSE> struct Fft;
template <bool INVERSE> struct Fft<4, INVERSE> {
    static DEVICE void run(Complex a[4]) { fft4<INVERSE>(a[0], a[1], a[2], a[3]); }
};
template <bool INVERSE> struct Fft<8, INVERSE> {
    static DEVICE void run(Complex a[8]) {
        Complex b[8];
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            b[i] = a[i] + a[i + 4];
            b[i + 4] = a[i] - a[i + 4];
        }
        b[5] = times_eighth_root<INVERSE>(b[5]);
        b[6] = times_i<INVERSE>(b[6]);
        b[7] = times_eighth_root<INVERSE>(times_i<INVERSE>(b[7]));
        fft4<INVERSE>(b[0], b[1], b[2], b[3]);
        fft4<INVERSE>(b[4], b[5], b[6], b[7]);
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            a[2 * i] = b[i];
            a[2 * i + 1] = b[i + 4];
        }
    }
};
template <bool INVERSE> struct Fft<16, INVERSE> {
    static DEVICE void run(Complex a[16]) {
        const float C = 0.923879532511286756f, S = 0.382683432365089772f;
#pragma unroll
        for (int i = 0; i < 4; ++i) fft4<INVERSE>(a[i], a[i + 4], a[i + 8], a[i + 12]);
        a[5] = times_root<INVERSE>(a[5], C, S);
        a[6] = times_eighth_root<INVERSE>(a[6]);
        a[7] = times_root<INVERSE>(a[7], S, C);
        a[9] = times_eighth_root<INVERSE>(a[9]);
        a[10] = times_i<INVERSE>(a[10]);
        a[11] = times_eighth_root<INVERSE>(times_i<INVERSE>(a[11]));
        a[13] = times_root<INVERSE>(a[13], S, C);
        a[14] = times_eighth_root<INVERSE>(times_i<INVERSE>(a[14]));
        a[15] = times_root<INVERSE>(a[15], -C, -S);
#pragma unroll
        for (int k = 0; k < 4; ++k) fft4<INVERSE>(a[4 * k], a[4 * k + 1], a[4 * k + 2], a[4 * k + 3]);
#pragma unroll
        for (int k = 0; k < 4; ++k) // a[4k + q] holds output k + 4q
#pragma unroll
            for (int q = k + 1; q < 4; ++q) {
                const Complex c = a[4 * k + q];
                a[4 * k + q] = a[4 * q + k];
                a[4 * q + k] = c;
            }
    }
};
