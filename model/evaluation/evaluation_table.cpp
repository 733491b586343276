#include "model/evaluation/evaluation.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>

namespace ars {
namespace {

using Json = nlohmann::ordered_json;

/// A row of the table: key of the figure, words, unit, decimals.
struct TableRow {
    const char* key;
    const char* label;
    const char* unit;
    int decimals;
};

constexpr TableRow kRows[] = {
    {"radiance_psnr_mask", "radiance, PSNR in the mask", "dB", 2},
    {"radiance_ssim_mask", "radiance, SSIM in the mask", "", 4},
    {"radiance_psnr_full", "radiance, PSNR full picture", "dB", 2},
    {"radiance_ssim_full", "radiance, SSIM full picture", "", 4},
    {"radiance_lpips", "radiance, LPIPS", "", 4},
    {"pbr_psnr_mask", "PBR, PSNR in the mask", "dB", 2},
    {"pbr_ssim_mask", "PBR, SSIM in the mask", "", 4},
    {"pbr_psnr_full", "PBR, PSNR full picture", "dB", 2},
    {"pbr_ssim_full", "PBR, SSIM full picture", "", 4},
    {"pbr_lpips", "PBR, LPIPS", "", 4},
    {"relit_psnr_mask", "relit, PSNR in the mask", "dB", 2},
    {"relit_ssim_mask", "relit, SSIM in the mask", "", 4},
    {"relit_lpips", "relit, LPIPS", "", 4},
    {"relit_unscaled_psnr_mask", "relit without albedo scale, PSNR", "dB", 2},
    {"relit_unscaled_ssim_mask", "relit without albedo scale, SSIM", "", 4},
    {"mask_iou", "mask, intersection over union", "", 4},
    {"albedo_psnr", "albedo, PSNR (sRGB)", "dB", 2},
    {"albedo_psnr_linear", "albedo, PSNR (linear)", "dB", 2},
    {"albedo_mae", "albedo, mean error (linear)", "", 4},
    {"albedo_unscaled_psnr", "albedo without scale, PSNR (sRGB)", "dB", 2},
    {"photograph_as_albedo_psnr", "photograph as albedo, PSNR (sRGB)", "dB", 2},
    {"photograph_as_albedo_psnr_linear", "photograph as albedo, PSNR (linear)", "dB", 2},
    {"normal_deg", "normal, mean angle", "deg", 2},
    {"normal_median_deg", "normal, median angle", "deg", 2},
    {"depth_mm", "depth, mean error", "mm", 2},
    {"depth_median_mm", "depth, median error", "mm", 2},
    {"roughness_mae", "roughness, mean error", "", 4},
    {"roughness_psnr", "roughness, PSNR", "dB", 2},
    {"ao_mae", "occlusion, mean error", "", 4},
    {"ao_psnr", "occlusion, PSNR", "dB", 2},
};

std::string numberText(const Json& mean, const TableRow& row) {
    const auto found = mean.find(row.key);
    if (found == mean.end()) return "-";
    // JSON has no infinity: two pictures that are the same.
    if (!found->is_number()) return "inf";
    return fmt::format("{:.{}f}", found->get<double>(), row.decimals);
}

/// "radiance, LPIPS (vgg)": a figure without its network says nothing.
std::string labelText(const TableRow& row, const Json& report) {
    const bool lpips = std::string_view(row.key).ends_with("_lpips") && report.at("lpips").is_object();
    return lpips ? fmt::format("{} ({})", row.label, report.at("lpips").value("network", "")) : row.label;
}

std::string joined(const Json& list) {
    std::string text;
    for (const Json& item : list) {
        if (!text.empty()) text += " ";
        text += item.is_string() ? item.get<std::string>() : item.dump();
    }
    return text;
}

std::string tripleText(const Json& triple) {
    return fmt::format("{:.3f} {:.3f} {:.3f}", triple[0].get<double>(), triple[1].get<double>(),
                       triple[2].get<double>());
}

/// The views without figures: "  left out, nobody in the mask: 22010708 3, 22010710 3".
std::string leftOutText(const Json& set) {
    constexpr std::size_t kMost = 8;
    const Json& views = set.at("left_out");
    if (views.empty()) return "";
    std::string text = "  left out, nobody in the mask:";
    for (std::size_t i = 0; i < std::min(views.size(), kMost); ++i) {
        text += fmt::format("{} {} {}", i > 0 ? "," : "", views[i].value("camera", ""), views[i].value("frame", 0));
    }
    if (views.size() > kMost) text += fmt::format(" and {} more", views.size() - kMost);
    return text + "\n";
}

/// One number for one light; where the sets were under several, one for each.
std::string lightText(const Json& report) {
    constexpr const char* kKey = "light_irradiance_correlation";
    const auto line = [](const std::string& whose, const Json& value) {
        const std::string number = value.is_number() ? fmt::format("{:.4f}", value.get<double>()) : "-";
        return fmt::format("light{}: correlation of the irradiance   {}\n", whose, number);
    };
    if (!report.contains(kKey)) return "";
    if (report.at(kKey).is_number()) return line("", report.at(kKey));
    std::string text;
    for (const Json& set : report.at("sets")) {
        if (set.contains(kKey) && set.at(kKey).is_number()) text += line(" of " + set.value("name", ""), set.at(kKey));
    }
    return text;
}

} // namespace

std::string evaluationTable(const Json& report) {
    std::string text = fmt::format("{}\nprotocol {}: {}\n", report.value("avatar", ""), report.value("protocol", ""),
                                   report.value("protocol_text", ""));
    std::vector<std::pair<std::string, const Json*>> columns;
    for (const Json& set : report.at("sets")) {
        text += fmt::format("{}: split {}, cameras {}, frames {}\n", set.value("name", ""), set.value("split", ""),
                            joined(set.at("cameras")), joined(set.at("frames")));
        text += leftOutText(set);
        columns.emplace_back(set.value("name", ""), &set.at("mean"));
    }
    if (columns.size() > 1) columns.emplace_back("all", &report.at("mean"));
    text += fmt::format("\n{:<38}", "mean over views");
    for (const auto& [name, mean] : columns) text += fmt::format(" {:>14}", name);
    text += "\n";
    for (const TableRow& row : kRows) {
        const bool any = std::any_of(columns.begin(), columns.end(),
                                     [&](const auto& column) { return column.second->contains(row.key); });
        if (!any) continue;
        text += fmt::format("{:<34} {:<3}", labelText(row, report), row.unit);
        for (const auto& [name, mean] : columns) text += fmt::format(" {:>14}", numberText(*mean, row));
        text += "\n";
    }
    text += "\n";
    if (report.contains("albedo_scale"))
        text += fmt::format("albedo scale (red, green, blue)        {}\n", tripleText(report.at("albedo_scale")));
    text += lightText(report);
    if (report.at("lpips").is_object()) {
        text += fmt::format("LPIPS with the weights                 {}, {}\n", report.at("lpips").value("backbone", ""),
                            report.at("lpips").value("heads", ""));
    }
    text += fmt::format("{:<38} not computed\n", report.at("lpips").is_object() ? "FID" : "LPIPS, FID");
    return text;
}

} // namespace ars
