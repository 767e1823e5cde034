"""The report of a part that people sign: a document of sections, as HTML or PDF."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.report.job_report.assembly import report_document as report_document
    from lmctl.report.job_report.document import ReportDocument as ReportDocument
    from lmctl.report.job_report.document import ReportSection as ReportSection
    from lmctl.report.job_report.pictures import report_pictures as report_pictures
    from lmctl.report.job_report.report_html import report_as_html as report_as_html
    from lmctl.report.job_report.report_pdf import report_as_pdf as report_as_pdf

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "ReportDocument": "lmctl.report.job_report.document",
    "ReportSection": "lmctl.report.job_report.document",
    "report_as_html": "lmctl.report.job_report.report_html",
    "report_as_pdf": "lmctl.report.job_report.report_pdf",
    "report_document": "lmctl.report.job_report.assembly",
    "report_pictures": "lmctl.report.job_report.pictures",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
