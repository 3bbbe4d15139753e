"""The report of an evaluation: one HTML file that needs nothing else."""

from checkweigher_validation.report.page import render, write_report

__all__ = ['render', 'write_report']
