// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>

#include "tools/train/evaluate.h"

void lab_scores_report(lab_report *j, const lab_scores *s) {
  lab_report_num(j, "psnr", s->psnr);
  lab_report_num(j, "ssim", s->ssim);
  if (s->has_lpips) lab_report_num(j, "lpips_squeeze", s->lpips);
  if (s->n_depth) {
    lab_report_num(j, "abs_rel", s->abs_rel);
    lab_report_num(j, "rmse", s->rmse);
  }
  if (s->n_with_mask) {
    lab_report_int(j, "views_with_mask", s->n_with_mask);
    lab_report_num(j, "unmasked", s->counted);
  }
  if (s->covisible_by) {
    lab_report_text(j, "covisible_by", s->covisible_by);
    lab_report_num(j, "mask_coverage", s->coverage);
    lab_report_int(j, "masked_views", s->n_masked);
  }
  if (s->n_masked) {
    lab_report_num(j, "mpsnr", s->mpsnr);
    lab_report_num(j, "mssim", s->mssim);
    if (s->has_lpips) lab_report_num(j, "mlpips", s->mlpips);
  }
  lab_report_int(j, "views", s->n);
}

void lab_scores_print(const lab_scores *s) {
  printf("PSNR %.2f dB, SSIM %.4f", s->psnr, s->ssim);
  if (s->has_lpips) printf(", LPIPS %.4f", s->lpips);
  if (s->n_depth) printf(", depth AbsRel %.4f, RMSE %.4f", s->abs_rel, s->rmse);
  if (s->n_with_mask) printf(" over the %.1f %% of the pixels that masks leave", 100 * s->counted);
  if (!s->covisible_by) return;
  printf("; %.1f %% of the pixels co-visible by %s", 100 * s->coverage, s->covisible_by);
  if (s->n_masked) printf(": mPSNR %.2f dB, mSSIM %.4f", s->mpsnr, s->mssim);
  if (s->n_masked && s->has_lpips) printf(", mLPIPS %.4f", s->mlpips);
}

void lab_time_scores_report(lab_report *j, const lab_scores *s) {
  lab_report_num(j, "time_psnr", s->psnr);
  lab_report_num(j, "time_ssim", s->ssim);
  if (s->has_lpips) lab_report_num(j, "time_lpips_squeeze", s->lpips);
  if (s->n_depth) lab_report_num(j, "time_abs_rel", s->abs_rel);
  lab_report_int(j, "time_views", s->n);
}
